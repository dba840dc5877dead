"""Search for settings of a stack that fail less: Optuna proposes, a race over cases and seeds decides.

Every setting meets the same cases and seeds (common random numbers), those cases first that tell settings apart. A
setting leaves the race where Wald's sequential test on the runs that differ from the best setting's says that it is
worse, with the error rate of a verdict, and it is not faster. Optuna is asked for a batch at a time, whose size follows
from the runs so far, and told its results in the order of asking, so the search is the same for any number of workers,
and resumes by asking again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from rvsg.core.errors import InputError, how_to_install
from rvsg.core.records import Record
from rvsg.core.seeds import seed_for
from rvsg.evaluation.verdict import DEFAULT, Procedure
from rvsg.runs.attempt import Failure
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.suites.suite_folder import SuiteCase
from rvsg.tune.setting_runs import VIOLATION, SettingRun, SettingRuns, Values

if TYPE_CHECKING:
    import optuna

Optimiser = Literal["tpe", "cmaes", "nsga2"]
BATCH = 4
"""Settings that are asked for together, whatever the number of workers; fewer where the budget holds no more."""
SEEDS = 3
"""Seeds of each case in the search."""
WORSE = 0.8
"""A setting is worse where, of the runs that differ, this share is worse rather than half of them."""
MOST_ON_FRONT = 7
TIME_WEIGHT, JERK_WEIGHT, LIMIT_WEIGHT = 0.05, 0.01, 10.0
"""Weights of time and jerk, relative to those before tuning, and of broken limits, beside the cost of a run: a run
that violates costs 1, so time decides between settings that violate equally often."""


class Score(Record):
    """What the runs of a setting say, beside the runs before tuning of the same cases and seeds."""

    cost: float
    """Mean cost of a run: violations and contacts by their severity."""
    violated: int
    contacts: int
    runs: int
    time: float
    """Mean time relative to that before tuning."""
    jerk: float
    """Mean jerk relative to that before tuning."""
    broken_cases: tuple[str, ...] = ()
    """Cases that passed before tuning and fail."""
    new_contacts: tuple[str, ...] = ()
    """Cases with contact that had none before tuning."""

    @property
    def sort_key(self) -> tuple[float, float, float]:
        """What is minimised, in the order of importance."""
        return self.cost, self.time, self.jerk


@dataclass(eq=False)
class TunedSetting:
    """A setting in the race."""

    number: int
    values: dict[str, float]
    runs: dict[tuple[str, int], SettingRun] = field(default_factory=dict)
    failures: int = 0
    """Runs in which the stack failed, or that could not be made."""
    lost_to: int | None = None
    """The number of the setting that the race found better."""
    refused: str = ""
    """Why the stack or the simulator refuses the setting."""
    score: Score | None = None
    """None for a setting that left the race."""

    @property
    def is_complete(self) -> bool:
        """Whether it met every case and seed, and the stack never failed."""
        return self.score is not None and not self.failures


def score_of(
    runs: Mapping[tuple[str, int], SettingRun],
    before: Mapping[tuple[str, int], SettingRun],
    judging: Procedure = DEFAULT,
) -> Score:
    """Return the score of runs, beside those before tuning on the same cases and seeds."""
    pairs = [(runs[key], before[key]) for key in before if key in runs]
    cases = dict.fromkeys(run.case for run, _ in pairs)
    by_case = {case: [(a, b) for a, b in pairs if a.case == case] for case in cases}

    def begins(flag: Callable[[SettingRun], bool]) -> tuple[str, ...]:
        """Return the cases in which something happens more than rarely that never did before."""
        return tuple(
            case
            for case, rows in by_case.items()
            if not any(flag(old) for _, old in rows) and judging.violated(sum(flag(new) for new, _ in rows), len(rows))
        )

    return Score(
        cost=math.fsum(run.cost for run, _ in pairs) / len(pairs),
        violated=sum(run.violated for run, _ in pairs),
        contacts=sum(run.contact for run, _ in pairs),
        runs=len(pairs),
        time=math.fsum(run.time_s for run, _ in pairs) / math.fsum(run.time_s for _, run in pairs),
        jerk=math.fsum(run.jerk for run, _ in pairs) / max(1e-9, math.fsum(run.jerk for _, run in pairs)),
        broken_cases=begins(lambda run: run.violated),
        new_contacts=begins(lambda run: run.contact),
    )


def is_worse(
    candidate: Mapping[tuple[str, int], SettingRun],
    best: Mapping[tuple[str, int], SettingRun],
    judging: Procedure = DEFAULT,
) -> bool:
    """Return whether the sequential test of a verdict says that a setting is worse than the best, and it is no faster.

    Among runs whose cost differs, a setting that is as good loses half. The likelihood ratio of `WORSE` against one
    half crosses the bound of a verdict with at most its error rate, however often one looks.
    """
    pairs = [(run, best[key]) for key, run in candidate.items() if key in best]
    lost = sum(run.cost > other.cost for run, other in pairs)
    won = sum(run.cost < other.cost for run, other in pairs)
    ratio = lost * math.log(WORSE / 0.5) + won * math.log((1.0 - WORSE) / 0.5)
    faster = math.fsum(run.time_s for run, _ in pairs) < math.fsum(other.time_s for _, other in pairs)
    return ratio >= math.log(1.0 / judging.error_rate) and not faster


class ParameterSearch:
    """A race of settings over cases and seeds.

    Args:
        parameters: what may change, each with its present value.
        cases: the cases for tuning.
        runs: makes and stores the runs.
        fixed: values of other parameters in every setting that is tried.
        seed: decides the seeds of runs and of the optimiser.
        more_time: how much longer the robot may take on average, as a share.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        cases: Sequence[SuiteCase],
        runs: SettingRuns,
        *,
        fixed: Values | None = None,
        seed: int = 0,
        optimiser: Optimiser = "tpe",
        more_time: float = 0.05,
    ) -> None:
        self.parameters = {each.name: each for each in parameters}
        self.cases = {each.name: each for each in cases}
        self.judging = cases[0].judging
        self.fixed = dict(fixed or {})
        self.more_time = more_time
        self.seeds = [seed_for(seed, "tuning", k) for k in range(SEEDS)]
        self.candidates: list[TunedSetting] = []
        self.spent = 0
        self._runs = runs
        self._study = _study(optimiser, seed)
        self._differs = dict.fromkeys(self.cases, 0)

    @property
    def before(self) -> TunedSetting:
        """The setting before tuning."""
        return self.candidates[0]

    @property
    def best(self) -> TunedSetting:
        """The complete setting with the best score; broken limits count against a setting."""
        return min((each for each in self.candidates if each.is_complete), key=self.rank)

    @property
    def _least_gain(self) -> float:
        """Half a violating run: what gains less is not worth a change."""
        return 0.5 * VIOLATION / len(self.before.runs)

    def gains(self, candidate: TunedSetting) -> bool:
        """Return whether a setting is better than the one before tuning by enough to be proposed."""
        return self._value(candidate.score) + self._least_gain < self._value(self.before.score)

    def rank(self, candidate: TunedSetting) -> tuple[float, int]:
        """Return the value that the optimiser minimises, the earlier of equals first."""
        return self._value(candidate.score), candidate.number

    def _value(self, score: Score | None) -> float:
        assert score is not None
        late = max(0.0, score.time - 1.0 - self.more_time)
        limits = LIMIT_WEIGHT * late + (len(score.broken_cases) + len(score.new_contacts)) / max(1, len(self.cases))
        return score.cost + TIME_WEIGHT * score.time + JERK_WEIGHT * score.jerk + limits

    def holds(self, candidate: TunedSetting) -> bool:
        """Return whether a setting may be proposed: no case breaks, no contact begins, and it takes no longer."""
        score = candidate.score
        return (
            score is not None
            and candidate.is_complete
            and not (score.broken_cases or score.new_contacts or score.time > 1.0 + self.more_time + 1e-9)
        )

    def begin(self) -> TunedSetting:
        """Run the setting before tuning on every case and seed."""
        values = {name: float(each.present or 0.0) for name, each in self.parameters.items()}
        self._study.enqueue_trial(values)
        first = TunedSetting(0, values)
        self.candidates.append(first)
        trial = self._study.ask(self._distributions())
        for block in self._blocks():
            self._race([first], block)
        if first.failures:
            raise InputError(
                f"The stack fails in {first.failures} of {len(first.runs)} runs before anything is changed. Mend it "
                "first: `rvsg simulate` shows why.",
                code="stack-fails",
            )
        first.score = score_of(first.runs, first.runs, self.judging)
        self._study.tell(trial, self._value(first.score))
        return first

    def run(self, budget: int) -> Iterator[None]:
        """Ask, race and tell while the runs that are left suffice for another setting; yields after each batch."""
        while (count := min(BATCH, (budget - self.spent) // len(self.before.runs))) > 0:
            trials = [self._study.ask(self._distributions()) for _ in range(count)]
            batch = [
                TunedSetting(len(self.candidates) + k, self._values(trial.params)) for k, trial in enumerate(trials)
            ]
            best, done = self.best, 0
            for done, block in enumerate(self._blocks(), 1):
                live = [each for each in batch if each.lost_to is None and not each.failures]
                self._race(live, block)
                for candidate, trial in zip(batch, trials, strict=True):
                    if candidate not in live or candidate.failures:
                        continue
                    score = score_of(candidate.runs, self.before.runs, self.judging)
                    trial.report(self._value(score), done)
                    if is_worse(candidate.runs, best.runs, self.judging) or self._is_slow(candidate, score):
                        candidate.lost_to = best.number
                    elif len(candidate.runs) == len(self.before.runs):
                        candidate.score = score
            self._tell(batch, trials)
            self.candidates += batch
            yield

    def run_settings(self, settings: Iterable[Values], budget: int) -> Iterator[None]:
        """Try these settings in their order, without a race, while the runs that are left suffice for another one."""
        for values in settings:
            if self.spent + len(self.before.runs) > budget:
                return
            tried = self.try_out({**self.before.values, **values})
            tried.number = len(self.candidates)
            self.candidates.append(tried)
            yield

    def _is_slow(self, candidate: TunedSetting, score: Score) -> bool:
        """Return whether a setting takes too long by more than as much again as is allowed, once it met every case."""
        return len(candidate.runs) >= len(self.cases) and score.time > 1.0 + 2.0 * self.more_time

    def try_out(self, values: Mapping[str, float]) -> TunedSetting:
        """Return a setting with its score on every case and seed; it takes no part in the race."""
        tried = TunedSetting(-1, dict(values))
        self._race([tried], list(self.before.runs))
        tried.score = score_of(tried.runs, self.before.runs, self.judging) if tried.runs else None
        return tried

    def simplified(self, candidate: TunedSetting) -> TunedSetting:
        """Return a setting without the changes that gain less than half a violating run, the least important first."""
        most = self._value(candidate.score) + self._least_gain
        for name in 2 * list(reversed(self.importances() or dict.fromkeys(self.parameters, 0.0))):
            tried = self.try_out({**candidate.values, name: self.before.values[name]})
            if self.holds(tried) and self._value(tried.score) <= most:
                tried.number, candidate = candidate.number, tried
        return candidate

    def _tell(self, batch: Sequence[TunedSetting], trials: Sequence[optuna.trial.Trial]) -> None:
        from optuna.trial import TrialState

        for candidate, trial in zip(batch, trials, strict=True):
            if candidate.failures:
                self._study.tell(trial, state=TrialState.FAIL)
            elif candidate.score is None:
                self._study.tell(trial, state=TrialState.PRUNED)
            else:
                self._study.tell(trial, self._value(candidate.score))
            for key, run in candidate.runs.items():
                self._differs[key[0]] += run.cost != self.before.runs[key].cost

    def _race(self, live: Sequence[TunedSetting], block: Sequence[tuple[str, int]]) -> None:
        wanted = [(each, case, seed) for each in live for case, seed in block]
        made = self._runs.run((each.values, self.cases[case], seed) for each, case, seed in wanted)
        for (candidate, case, seed), run in zip(wanted, made, strict=True):
            self.spent += 1
            if isinstance(run, Failure):
                candidate.failures += 1
                candidate.refused = candidate.refused or run.reason
            else:
                candidate.runs[case, seed] = run
                candidate.failures += run.failed

    def _blocks(self) -> Iterator[list[tuple[str, int]]]:
        """Yield the cases and seeds of a race: the first seed in four steps, cases that tell settings apart first."""
        violated = {case for (case, _), run in self.before.runs.items() if run.cost}
        order = sorted(self.cases, key=lambda case: (-self._differs[case], case not in violated, case))
        step = max(1, -(-len(order) // 4))
        for k in range(0, len(order), step):
            yield [(case, self.seeds[0]) for case in order[k : k + step]]
        for seed in self.seeds[1:]:
            yield [(case, seed) for case in order]

    def _values(self, numbers: Mapping[str, float]) -> dict[str, float]:
        return self.fixed | {name: each.value(numbers[name]) for name, each in self.parameters.items()}

    def _distributions(self) -> dict[str, Any]:
        from optuna.distributions import FloatDistribution, IntDistribution

        return {
            name: IntDistribution(int(each.low), int(each.high), log=each.log)
            if each.whole
            else FloatDistribution(each.low, each.high, log=each.log)
            for name, each in self.parameters.items()
        }

    def importances(self) -> dict[str, float]:
        """Return how much of what distinguishes good settings each parameter decides (PED-ANOVA), largest first.

        Empty where too few settings are complete to tell.
        """
        from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
        from optuna.trial import TrialState

        complete = self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        if len(self.parameters) < 2 or len({trial.value for trial in complete}) < 8:
            return {}
        return dict(get_param_importances(self._study, evaluator=PedAnovaImportanceEvaluator()))

    def front(self) -> tuple[TunedSetting, ...]:
        """Return the settings that hold the limits and that no other beats in cost, time and jerk.

        At most `MOST_ON_FRONT`: the best, the fastest, the smoothest, then the next best.
        """
        keys = {each: each.score.sort_key for each in self.candidates if each.score is not None and self.holds(each)}
        front = sorted(
            (each for each in keys if not any(_beats(keys[other], keys[each]) for other in keys)), key=self.rank
        )
        ends = [min(front, key=lambda each: (keys[each][k], each.number)) for k in range(3) if front]
        return tuple(dict.fromkeys([*front[:1], *ends, *front]))[:MOST_ON_FRONT]


def _beats(one: Sequence[float], other: Sequence[float]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))


def _study(optimiser: Optimiser, seed: int) -> optuna.Study:
    """Return a study of Optuna in memory: what it is told can be told again."""
    try:
        import optuna
        from optuna import samplers
    except ImportError:
        raise InputError(f"`rvsg tune` needs Optuna: {how_to_install('tune')}.", code="optuna-missing") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    number = seed_for(seed, "optimiser")
    sampler: samplers.BaseSampler
    match optimiser:
        case "tpe":
            sampler = samplers.TPESampler(seed=number, constant_liar=True, n_startup_trials=12)
        case "cmaes":
            sampler = samplers.CmaEsSampler(seed=number)
        case "nsga2":
            sampler = samplers.NSGAIISampler(seed=number, population_size=3 * BATCH)
    return optuna.create_study(sampler=sampler)


AT_END = 0.1
"""A value is at the end of a range within this share of it."""
ENOUGH_EACH, ENOUGH = 10, 50
"""Settings for each parameter, and at most, before the best of them say whether a range limits a case."""


class Unsolved(Record):
    """A case that no setting tried solves."""

    case: str
    settings: int
    """Settings that met it with all seeds, and that all violate."""
    least: int
    """Violations of the best of them."""
    of: int
    needed: int
    """Settings that would be enough to look for a parameter that limits it."""
    limited_by: str | None
    """The parameter whose best values lie at the end of its range; None where none does, or fewer were tried."""
    end: float | None = None
    """That end of the range."""


def unsolved(search: ParameterSearch) -> Iterator[Unsolved]:
    """Yield the cases that violate before tuning and with every setting, with the parameter that limits each."""
    needed = min(ENOUGH, ENOUGH_EACH * len(search.parameters))
    for case in search.cases:
        keys = [(case, seed) for seed in search.seeds]
        met = [each for each in search.candidates if not each.failures and all(key in each.runs for key in keys)]
        costs = {each.number: sum(each.runs[key].cost for key in keys) for each in met}
        violations = {each.number: sum(each.runs[key].violated for key in keys) for each in met}
        if not violations[0] or min(violations.values()) == 0:
            continue
        good = sorted(met, key=lambda each: (costs[each.number], each.number))[: max(3, len(met) // 5)]
        ends: dict[str, tuple[float, float]] = {}
        for parameter in search.parameters.values() if len(met) >= needed else ():
            at = sorted(parameter.share(each.values[parameter.name]) for each in good)[len(good) // 2]
            if at <= AT_END or at >= 1.0 - AT_END:
                ends[parameter.name] = (min(at, 1.0 - at), parameter.low if at < 0.5 else parameter.high)
        limiting = min(ends, key=lambda name: ends[name][0], default=None)
        yield Unsolved(
            case=case,
            settings=len(met),
            least=min(violations.values()),
            of=len(keys),
            needed=needed,
            limited_by=limiting,
            end=None if limiting is None else ends[limiting][1],
        )
