"""A campaign that is told to end ends, whatever was going on at that moment."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.cli.test_run import SMALL, records

from rvsg.cli import main
from rvsg.cli.interruption import AT_ONCE, interruptible
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interruption_that_a_library_swallows_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], how: signal.Signals
) -> None:
    main(["run", *SMALL, "--out", str(tmp_path / "whole")])
    original, made = KinematicSimulator.run, []

    def deaf(self: KinematicSimulator, scenario: Scenario, world: World, *, seed: int) -> Run:
        made.append(seed)
        if len(made) == 5:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(how)
        return original(self, scenario, world, seed=seed)

    monkeypatch.setattr(KinematicSimulator, "run", deaf)
    assert main(["run", *SMALL, "--out", str(tmp_path / "one")]) == 3
    assert len(made) == 5
    assert "Resume with: rvsg run --out" in capsys.readouterr().err
    assert main(["run", "--out", str(tmp_path / "one")]) == 0
    assert records(tmp_path / "one") == records(tmp_path / "whole")


def test_the_handlers_of_before_are_back_afterwards() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with interruptible() as interruption:
        interruption.check()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            interruption.check()
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_an_error_that_only_follows_from_an_interruption_is_no_defect(capsys: pytest.CaptureFixture[str]) -> None:
    class Callback:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), interruptible() as interruption:
        Callback()
        assert interruption.asked
        raise RuntimeError("the callback gave nothing")
    assert capsys.readouterr().err == ""


def ended(code: str) -> subprocess.CompletedProcess[str]:
    """A program in a group of its own, so that what it sends to its group stays there."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=Path(__file__).parents[2],
        start_new_session=True,
    )


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="a terminal sends Ctrl-C to a process group")
def test_ctrl_c_while_the_workers_start_ends_in_order_and_resumes(tmp_path: Path) -> None:
    options = [*SMALL[: SMALL.index("--jobs")], "--jobs", "2"]
    done = ended(
        "import os, signal, sys\n"
        "import subprocess\n"
        "from rvsg.cli import main\n"
        "original = subprocess.Popen\n"
        "def begun_with_ctrl_c(*how, **more):\n"
        "    subprocess.Popen = original\n"
        "    process = original(*how, **more)\n"
        "    os.killpg(0, signal.SIGINT)\n"
        "    return process\n"
        "subprocess.Popen = begun_with_ctrl_c\n"
        f"sys.argv[1:] = {['run', *options, '--out', str(tmp_path / 'one')]!r}\n"
        "sys.exit(main())\n"
    )
    assert done.returncode == 3, done.stderr
    assert "Resume with: " in done.stderr and "Traceback" not in done.stderr
    assert main(["run", "--out", str(tmp_path / "one")]) == 0
    main(["run", *SMALL, "--out", str(tmp_path / "whole")])
    assert records(tmp_path / "one") == records(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("work", "told"),
    [
        (
            "try:\n        signal.raise_signal(2)\n    finally:\n        signal.raise_signal(15)\n",
            f"{AT_ONCE}\n",
        ),
        (
            "with interruption.interruptible() as one, one.at_once('Begin again.'):\n        signal.raise_signal(2)\n",
            "Begin again.\n",
        ),
        ("threading.Thread(target=time.sleep, args=(1000,)).start()\n    return 3\n", ""),
        ("import atexit\n    atexit.register(signal.raise_signal, signal.SIGINT)\n    return 3\n", ""),
    ],
    ids=["asked twice", "asked while it compiles", "a thread is left", "asked while it leaves"],
)
def test_a_process_that_was_interrupted_is_soon_gone_without_a_word_of_python(work: str, told: str) -> None:
    done = ended(
        "import signal, sys, threading, time\n"
        "from rvsg.cli import interruption\n"
        "interruption.LEAVING_S = 0.5\n"
        f"def work():\n    {work}"
        "sys.exit(interruption.until_gone(work))\n"
    )
    assert (done.returncode, done.stderr) == (3, told)
