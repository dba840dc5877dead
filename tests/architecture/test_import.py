import subprocess
import sys

HEAVY = ("numba", "sqlalchemy", "pydantic_ai", "openai", "scipy", "matplotlib", "nicegui")


def test_importing_rvsg_loads_no_backend() -> None:
    code = f"import rvsg, sys; print([m for m in {HEAVY!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_a_campaign_compiles_nothing_before_a_simulation_begins() -> None:
    code = "import rvsg, sys; rvsg.Campaign; print('numba' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "False"
