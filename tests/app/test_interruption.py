"""A campaign that is told to end ends, whatever was going on at that moment."""

from __future__ import annotations

import contextlib
import signal
from pathlib import Path

import pytest
from tests.app.test_run import SMALL, records

from rvsg.app.cli import main
from rvsg.app.cli.interruption import interruptible
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
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
