"""The watch over a robot: monitor, analyse, plan, legitimate, execute."""
