"""The embedded simulator: a Nav2-like robot among HuNavSim-like people, in one compiled loop."""
