"""Access to vision language models. Nothing here knows of robots, humans or worlds: only of messages and answers."""
