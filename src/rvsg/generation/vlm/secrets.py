"""Takes out of any text what must never be seen: keys from the environment and whatever looks like one."""

from __future__ import annotations

import os
import re

HIDDEN = "[hidden]"
_NAMES = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL)", re.IGNORECASE)
_LOOKS = (
    re.compile(r"\b(?:sk|pk|rk|xai|gsk|hf|ghp|AIza)[-_A-Za-z0-9]{12,}"),
    re.compile(r"(?i)\b(bearer|basic)\s+[A-Za-z0-9._~+/=-]{8,}"),
    re.compile(r"(?i)(?<=[?&])((?:api[-_]?)?key|token)=[^&\s\"']+"),
    re.compile(r"(?<=://)[^/\s:@]+:[^/\s@]+(?=@)"),
)


def secrets_of_environment() -> tuple[str, ...]:
    """Values of environment variables whose names say they are secret, the longest first (at least 6 characters)."""
    found = {value for name, value in os.environ.items() if _NAMES.search(name) and len(value) >= 6}
    return tuple(sorted(found, key=lambda value: (-len(value), value)))


def hide_secrets(text: str, *extra: str) -> str:
    """The text with every secret of the environment, of `extra`, or that looks like a key, replaced."""
    for secret in (*(e for e in extra if e), *secrets_of_environment()):
        text = text.replace(secret, HIDDEN)
    for pattern in _LOOKS:
        text = pattern.sub(HIDDEN, text)
    return text
