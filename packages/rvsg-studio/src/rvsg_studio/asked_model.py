"""Which model is asked outside a campaign: named once, kept for the next time. Keys come from the environment alone."""

from __future__ import annotations

import contextlib
from typing import Any

from pydantic import BaseModel, ValidationError

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg_studio.frame import field, tag, text_input
from rvsg_studio.workspace import Workspace


class AskedModel(BaseModel, frozen=True):
    """A model, the server it is asked at where that is not its provider's, and what its calls may cost."""

    model: str = ""
    base_url: str = ""
    budget_usd: float | None = None

    @property
    def arguments(self) -> dict[str, Any]:
        """What a job has to know; InputError where no model is named."""
        if not self.model.strip():
            raise InputError("Name a model first: PROVIDER:NAME, for example openai-chat:gpt-4.1.")
        given = {"model": self.model.strip(), "base_url": self.base_url.strip() or None, "budget_usd": self.budget_usd}
        return {key: value for key, value in given.items() if value is not None}

    @property
    def options(self) -> str:
        """The same as options of a command line."""
        address = f" --base-url {self.base_url.strip()}" if self.base_url.strip() else ""
        budget = f" --budget-usd {self.budget_usd:g}" if self.budget_usd is not None else ""
        return f"--model {self.model.strip() or 'PROVIDER:NAME'}{address}{budget}"


def asked_model(workspace: Workspace) -> AskedModel:
    """Return the model that was named last."""
    path = workspace.own / "model.json"
    return AskedModel.model_validate_json(path.read_text(encoding="utf-8")) if path.is_file() else AskedModel()


def keep_model(workspace: Workspace, **values: Any) -> AskedModel:
    """Change what is kept of the model; InputError where a value is none."""
    try:
        made = AskedModel.model_validate(asked_model(workspace).model_dump() | values)
    except ValidationError as error:
        raise InputError(f"The model cannot be kept: {error.errors()[0]['msg']}.") from None
    write_whole(workspace.own / "model.json", made.model_dump_json())
    return made


def model_form(workspace: Workspace) -> None:
    """Lay out the fields that name a model; what is typed is kept at once."""
    known = asked_model(workspace)

    def budget(text: str) -> None:
        with contextlib.suppress(ValueError):  # an unfinished number
            keep_model(workspace, budget_usd=float(text) if text else None)

    with tag("div", cls="st-form"):
        with field("Model", help="PROVIDER:NAME; its key is read from the environment."):
            text_input(known.model, lambda text: keep_model(workspace, model=text), autocomplete="off")
        with field("Server", help="Only for an OpenAI-compatible server of your own"):
            text_input(known.base_url, lambda text: keep_model(workspace, base_url=text), autocomplete="off")
        with field("Budget in USD", help="It stops before its calls cost more."):
            text_input(known.budget_usd, budget, kind="number", min="0", step="any")
