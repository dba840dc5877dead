"""Make and check a world: propose a grid, labels and routes, and report every mistake."""
