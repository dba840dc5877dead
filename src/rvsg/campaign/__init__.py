"""The loop: ask, propose, simulate, evaluate, tell; search strategies, feedback and memory, confirmation."""
