"""Access to vision language models. Nothing here knows of robots, humans or worlds: only of messages and answers.

::

    model       Message, Request, Answer, the Model protocol (`ask(request)`), Scripted, and Budgeted
    client      the only module that imports pydantic-ai: one provider-neutral, retried, timed call
    recording   Recorded keeps every call; Replayed answers from a record only
    access      from a user's options to a model that is paced, budgeted, recorded or replayed
"""
