"""Tools of RVSG for assistants, over the Model Context Protocol."""
