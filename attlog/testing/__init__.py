"""Named checks of the estimator contract on closed-form motions with known truth.

For one's own filter, in a test file::

    import pytest
    from attlog.testing import checks

    CHECKS = checks("my_filter.py")

    @pytest.mark.parametrize("check", [c for _, c in CHECKS], ids=[n for n, _ in CHECKS])
    def test_my_filter(check):
        check()

or ``attlog check-estimator my_filter.py`` on the command line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from attlog.core.errors import AttlogError, PluginTimeout
from attlog.estimators import Estimator, EstimatorSpec, not_compiled
from attlog.estimators.interface import AIDS
from attlog.testing import contract
from attlog.testing.motions import CheckFailed, Motion, Noise, Subject, flight, motion, one_turn, require, still, swing

__all__ = [
    "CheckFailed",
    "CheckOutcome",
    "Motion",
    "Noise",
    "about",
    "check_estimator",
    "checks",
    "flight",
    "motion",
    "one_turn",
    "speed_ns",
    "still",
    "swing",
]

Check = Callable[[Subject], None]


@dataclass(frozen=True, slots=True)
class CheckOutcome:
    """Result of one check; ``message`` says what was expected and what happened."""

    name: str
    passed: bool
    message: str


def checks(name: str | EstimatorSpec | Estimator) -> list[tuple[str, Callable[[], None]]]:
    """Return the checks of an estimator: name, and function that raises CheckFailed.

    ``name`` is ``NAME[@PRESET][:k=v,...]``, ``FILE.py[...]``, a row or an estimator. What applies follows from its
    needs and uses: a filter without magnetometer is not asked for heading. UsageError or PluginError if it cannot be
    loaded.
    """
    subject = Subject.of(name)
    return [(title, partial(check, subject)) for title, check in _applicable(subject)]


def check_estimator(
    name: str | EstimatorSpec | Estimator, report: Callable[[CheckOutcome], None] | None = None
) -> list[CheckOutcome]:
    """Return the outcome of every check that applies, in order.

    ``report`` gets each at once. A check that ends in any exception has failed. UsageError or PluginError if the
    estimator cannot be loaded, PluginTimeout where a check takes too long: the others would, too.
    """
    outcomes = []
    late: PluginTimeout | None = None
    for title, check in checks(name):
        try:
            check()
            outcome = CheckOutcome(title, True, "")
        except PluginTimeout as error:
            late, outcome = error, CheckOutcome(title, False, str(error))
        except (AttlogError, AssertionError) as error:
            outcome = CheckOutcome(title, False, str(error))
        except Exception as error:
            outcome = CheckOutcome(title, False, f"{type(error).__name__}: {error}")
        outcomes.append(outcome)
        if report is not None:
            report(outcome)
        if late is not None:
            raise late
    return outcomes


def about(name: str | EstimatorSpec | Estimator) -> list[str]:
    """Return sentences on an unusual way of running: whole segments, or plain Python.

    Errors as in :func:`checks`; PluginError also where a step fails at once.
    """
    estimator = Subject.of(name).estimator
    if estimator.run is not None:
        return ["run() takes whole segments: checks of single steps and start attitudes are left out."]
    reason = not_compiled(estimator)
    if not reason:
        return []
    return [
        f"step runs in plain Python, some hundred times slower than compiled, because numba cannot compile it: {reason}"
    ]


def speed_ns(name: str | EstimatorSpec | Estimator) -> float:
    """Return nanoseconds per update on 20,000 samples, best of three runs, without compiling."""
    subject, m = Subject.of(name), swing(100.0, 200.0)
    subject.run(m.part(slice(0, 10)))
    return min(subject.run(m).ns_per_update for _ in range(3))


def describes_itself(s: Subject) -> None:
    """Title, source and meanings are given; presets keep the ranges."""
    e = s.estimator
    require(e.title and e.title != e.name, "the docstring's first line should say what the filter is")
    require(e.source, "SOURCE should name the paper or package")
    names = [p.name for p in e.parameters]
    require(len(set(names)) == len(names), f"a parameter is declared twice: {names}")
    for p in e.parameters:
        require(p.meaning and p.source, f"parameter {p.name} has no meaning or no source")
        p.check(p.default, e.name)
    for preset in (None, *e.presets):
        e.resolve(preset)


def _applicable(s: Subject) -> list[tuple[str, Check]]:
    """Return names and functions in the order of a person's interest."""
    found: list[tuple[str, Check]] = [_named(describes_itself), _named(contract.gives_unit_quaternions)]
    for i, axis in enumerate(contract.AXES):
        found.append((f"follows_a_turn[{axis}]", partial(contract.follows_a_turn, axis=i)))
    observed = ([0, 1] if s.corrects_tilt else []) + ([2] if s.corrects_heading else [])
    if s.steps:
        for i in observed:
            title = f"corrects_an_offset[{contract.AXES[i]}]"
            found.append((title, partial(contract.corrects_an_offset, axis=i)))
    conditions: list[tuple[Check, bool]] = [
        (contract.converges_from_170_deg, s.steps and s.corrects_tilt),
        (contract.finds_the_attitude_at_rest, s.uses_acc),
        (contract.starts_in_motion, s.corrects_tilt),
        (contract.works_at_every_heading, s.uses_mag),
        (contract.turns_with_the_earth, s.uses_mag or s.steps),
        (contract.takes_the_field_in_any_unit, s.uses_mag),
        (contract.finds_the_gyro_bias, "bias" in s.estimator.slices),
        (contract.works_without_magnetometer, "mag" not in s.estimator.needs),
        (contract.refuses_without_magnetometer, "mag" in s.estimator.needs),
        (contract.refuses_without_gnss, s.needs_gnss),
        (contract.works_with_a_slow_magnetometer, s.corrects_heading and "gyro" in s.estimator.uses),
        (contract.does_not_depend_on_the_sampling_rate, s.steps),
        (contract.looks_back_only, s.estimator.causal),
        (contract.keeps_its_norm, True),
        (contract.uses_every_parameter, True),
        (contract.survives_nan, True),
        (contract.bridges_a_short_gap, True),
        (contract.restarts_after_a_long_gap, True),
        (contract.survives_a_time_jump, True),
        (contract.drops_times_that_do_not_rise, True),
        (contract.drops_impossible_values, True),
        (contract.survives_dead_sensors, True),
        (contract.takes_few_samples, True),
        (contract.takes_any_array, True),
        (contract.leaves_its_input_alone, True),
        (contract.repeats_itself, True),
        (contract.works_with_aids, bool(s.estimator.uses & AIDS)),
        (contract.survives_few_aids, bool(s.estimator.uses & AIDS)),
        (contract.takes_aids_when_they_come, bool(s.estimator.uses & AIDS) and s.estimator.causal),
        (contract.takes_parameters_from_a_log, s.estimator.from_log is not None),
    ]
    return found + [_named(check) for check, applies in conditions if applies]


def _named(check: Check) -> tuple[str, Check]:
    return check.__name__, check
