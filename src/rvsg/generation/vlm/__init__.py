"""Access to vision language models. Nothing here knows of robots, humans or worlds: only of messages and answers.

::

    messages    Picture, Message, Request, Answer: what goes out and what comes back
    model       the Model protocol (`ask(request)`) and Scripted, its fake for tests and demonstrations
    access      the only module that imports pydantic-ai: one provider-neutral, retried, timed call
    faults      what an error of a service means, and what to do next
    pacing      Paced: limits calls at once and per minute
    budget      Budgeted: limits calls, tokens and dollars
    recording   Recorded: every call kept, and answered from the record where it is already known
    watching    Watched: tells of calls while they are made, and of what was spent
    replay      Replayed: answers from a record only, and says where the present prompts diverge
    secrets     what must never be seen, taken out of any text
"""
