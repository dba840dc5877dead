from pathlib import Path

SOURCES = Path(__file__).parents[2] / "src" / "rvsg"


def test_one_module_imports_the_clients_of_models() -> None:
    clients = ("pydantic_ai", "openai", "genai_prices")
    importing = {
        str(path.relative_to(SOURCES))
        for path in SOURCES.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.strip().startswith(tuple(f"{word} {client}" for word in ("import", "from") for client in clients))
    }
    assert importing == {"generation/vlm/client.py"}
