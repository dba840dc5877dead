"""A Brief becomes a Proposal: by a conversation with a vision language model, a heuristic, or chance."""
