"""The loop of self-adaptation: Monitor, Analyse, Plan, Legitimate, Execute over Knowledge."""
