"""Solve samples into poses, in the same way for tables, runs, replays and simulations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from functools import cached_property
from math import isinf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.knowledge import Knowledge, Prior
from ..core.settings import Config
from ..core.units import Booleans, Floats
from ..detectors.temperature import beam_shift, exact_readings, warmer_than_reference
from .object_pose import ObjectPose, transform
from .solution import (
    Poses,
    SampleEstimate,
    Samples,
    Solution,
    Status,
    covariance_columns,
    empty_solution,
    expanded_columns,
)
from .solver import solve_question
from .tally import Tally
from .zero import PoseColumns, ZeroPose, ZeroRequest, ZeroSearch, zero_findings, zero_text

#: Statuses of estimates that may converge from another start.
LOST = (Status.MAX_STEPS, Status.SINGULAR, Status.STALLED)


@check_arguments
class Measurement:
    """Solver of samples by a configuration, with counts and the zero of displacements.

    Parameters
    ----------
    config : Config
        The sensor, the knowledge of its beam (`solve`), and the measured object.
    columns : PoseColumns, optional
        Further columns of poses: displacements from a zero, covariances, expanded uncertainties.
    waits : bool
        Whether the zero begins with the first pose that fits its readings, as in a run.
    tally : Tally, optional
        The count of samples to which the new ones are added; a new count by default.

    Attributes
    ----------
    tally : Tally
        Counts of the samples so far, by their results.
    news : list of str
        Events of the zero since the last `take_news`.

    Raises
    ------
    InputError
        If the table of a zero cannot be read, or its poses are unusable.

    Examples
    --------
    >>> import numpy as np, facets
    >>> config = facets.load("paper")
    >>> rows = facets.readings(config.sensor, np.zeros((3, 8)))
    >>> measurement = facets.Measurement(config)
    >>> measurement.poses(facets.Samples(rows)).solution.ok.tolist()
    [True, True, True]
    >>> measurement.tally.statuses
    Counter({'converged': 3})
    """

    def __init__(
        self,
        config: Config,
        columns: PoseColumns | None = None,
        *,
        waits: bool = False,
        tally: Tally | None = None,
    ) -> None:
        self.config, self.columns = config, columns or PoseColumns()
        self.tally = Tally() if tally is None else tally
        self.at_rest = config.solve.knowledge(config.sensor)
        zero = self.columns.zero
        self.search = ZeroSearch(zero, config, waits) if zero else None
        self.news: list[str] = []
        if self.zero is not None:
            self.announce_zero()

    @property
    def zero(self) -> ZeroPose | None:
        """The reference pose of displacements; None until it is known."""
        return self.search.zero if self.search else None

    @property
    def is_measuring(self) -> bool:
        """Whether a zero was requested and is not known yet."""
        return self.search is not None and self.search.zero is None

    def poses(self, samples: Samples) -> Poses:
        """Solve samples, count them, and add them to the zero.

        Displacements are NaN until the zero is known. Raises `InputError` if the samples of the
        zero are unusable; with `waits`, the zero is measured again instead, and `news` reports it.
        """
        return self.finish(samples, *self.begin(samples))

    def poses_of_pieces(self, samples: Samples) -> Poses | None:
        """Solve and count samples of several pieces at once, with the same result as `poses` for
        one piece after the other.

        Returns None, and counts nothing, if the result could depend on the pieces.
        """
        if self.is_measuring or self.config.solve.start == "previous":
            return None
        estimate = self.estimate(samples)
        if not self.tally.may_join(estimate.solution):
            return None
        self.tally.add(self.config, samples, estimate)
        return self.finish(samples, estimate.solution, np.zeros(len(samples.readings), dtype=bool))

    def poses_of_all(self, parts: Iterable[Samples], what: str) -> Iterator[Poses]:
        """Solve all parts of a table, in their order, so that all poses have displacements.

        Parts are held in memory until the zero is known. Raises `InputError` if the table lacks the
        samples of the zero, or they are unusable.  what: the table's name in messages.
        """
        held, rows = [], 0
        for samples in parts:
            rows += len(samples.readings)
            held.append((samples, *self.begin(samples)))
            if not self.is_measuring:
                yield from (self.finish(*solved) for solved in held)
                held = []
        if self.search and rows:
            self.search.finish(what, rows)
        yield from (self.finish(*solved) for solved in held)

    def begin(self, samples: Samples) -> tuple[Solution, Booleans]:
        """Solve samples, count them, and add them to the zero.

        Returns the solution, and whether each sample belongs to the zero.
        """
        estimate = self.estimate(samples)
        self.tally.add(self.config, samples, estimate)
        solution = estimate.solution
        members = np.zeros(len(samples.readings), dtype=bool)
        if self.search and self.is_measuring:
            try:
                members = self.search.add(samples, solution)
            except InputError as error:
                if not self.search.waits:
                    raise
                self.news.append(f"is measured again: {error}")
            if self.zero is not None:
                self.announce_zero()
        return solution, members

    def finish(self, samples: Samples, solution: Solution, members: Booleans) -> Poses:
        """Complete the poses of solved samples.  members: (n,) whether each belongs to the zero."""
        columns = self.object_columns(solution, members, samples.temperature)
        return Poses(solution, members, columns)

    def skip(self, samples: Samples) -> Poses:
        """Count samples without solving them; their poses have the status SKIPPED."""
        has_parts = self.config.sensor.calibration is not None
        count = len(samples.readings)
        solution = empty_solution(count, Status.SKIPPED, has_parts)
        self.tally.add_statuses(solution, samples.numbers)
        return self.finish(samples, solution, np.zeros(count, dtype=bool))

    def estimate(self, samples: Samples) -> SampleEstimate:
        """Solve samples, without counting them."""
        sensor, options = self.config.sensor, self.config.solve
        warmer = warmer_than_reference(sensor, samples.temperature)
        exact = exact_readings(sensor, samples.readings, warmer)
        knowledge = self.knowledge(samples)
        if samples.place is not None and knowledge.beam != "free":
            exact = np.where(np.isfinite(samples.place).all(axis=1, keepdims=True), exact, np.nan)
        if warmer is not None:
            warmer = np.nan_to_num(warmer)
        question = options.question(knowledge)

        def solve(which: Any, start: Any) -> Solution:
            return solve_question(
                sensor,
                exact[which],
                question.rows(which),
                start,
                warmer=None if warmer is None else warmer[which],
            )

        solution = solve(np.s_[:], options.start)
        if options.start == "zero" and not solution.converged.all():
            retry(solution, solve, [len(exact)] if samples.ends is None else samples.ends)
        if samples.saturated is not None and samples.saturated.any():
            full = samples.saturated & (solution.status == Status.NON_FINITE)
            status = np.where(full, np.int8(Status.SATURATED), solution.status)
            solution = replace(solution, status=status)
        return SampleEstimate(solution, knowledge, exact)

    def knowledge(self, samples: Samples) -> Knowledge:
        """Prior knowledge of the beam at the samples' times and temperatures."""
        if self.at_rest.beam == "free":
            return self.at_rest
        if isinf(samples.place_sigma or 0.0):
            return replace(self.at_rest, beam="free")
        sensor, options = self.config.sensor, self.config.solve
        place, warmer = samples.place, warmer_than_reference(sensor, samples.temperature)
        if warmer is not None:
            shift = beam_shift(sensor, warmer)
            place = shift if place is None else place + shift
        if place is None:
            return self.at_rest
        place = np.nan_to_num(place)
        if samples.place_sigma is None:
            return options.knowledge(sensor, place)
        return replace(self.at_rest, beam=Prior(place + options.beam_offset, samples.place_sigma))

    @cached_property
    def object_names(self) -> tuple[str, ...]:
        """The names of the object's columns, of displacements and covariances."""
        has_parts = self.config.sensor.calibration is not None
        nothing = empty_solution(1, Status.NON_FINITE, has_parts)
        return tuple(self.object_columns(nothing, np.zeros(1, dtype=bool), None))

    def object_columns(
        self, solution: Solution, members: Booleans, temperature: Floats | None
    ) -> dict[str, Floats]:
        """The columns of the object, of its displacements from the zero, and of covariances.

        members: (n,) whether each sample belongs to the zero.
        """
        poses, body = {}, self.config.object
        if body is not None:
            poses["object_"] = transform(solution, body)
        if self.zero is not None:
            poses["displacement_"] = transform(
                solution, body, self.zero, members=members, temperature=temperature
            )
        elif self.is_measuring:
            poses["displacement_"] = unknown_displacements(solution)
        covariance, coverage = self.columns.covariance, self.columns.coverage
        columns = covariance_columns(solution) if covariance else {}
        if coverage is not None:
            columns |= expanded_columns(solution, coverage)
        for prefix, pose in poses.items():
            columns |= pose.columns(prefix, covariance, coverage)
        return columns

    def announce_zero(self) -> None:
        """Add the zero, which is now known, to the news."""
        self.news += [self.zero_text, *self.findings]

    @property
    def request(self) -> ZeroRequest | None:
        """The request for a zero of displacements; None for no displacements."""
        return self.columns.zero

    @property
    def zero_text(self) -> str:
        """The zero in words, for the provenance of a table; empty without a zero."""
        return zero_text(self.request, self.zero) if self.request and self.zero else ""

    @property
    def findings(self) -> list[str]:
        """Sentences on faults of the zero."""
        return zero_findings(self.zero) if self.zero else []

    def take_news(self) -> list[str]:
        """Return the news of the zero since the last call, and clear them."""
        news, self.news = self.news, []
        return news

    def messages(self) -> list[str]:
        """Sentences on the zero for a person who watches a run."""
        if not self.is_measuring:
            return self.findings
        if self.search and self.search.is_begun:
            return ["the zero is being measured: keep the mirror still"]
        return ["the zero waits for a pose that fits its readings; there is none yet"]

    def description(self) -> dict[str, Any]:
        """Description of the object, the zero and the columns' names for receivers of poses."""
        body = self.config.object
        return {
            "object": None if body is None else {
                "point_mm": list(body.point),
                "orientation_deg": np.degrees(body.orientation).tolist(),
            },
            "zero": None if self.request is None else self.request.text,
            "covariance": self.columns.covariance,
            "object_columns": list(self.object_names),
        }  # fmt: skip

    def zero_sentences(self) -> list[str]:
        """Sentences on the zero after the last sample."""
        if self.request is None:
            return []
        if self.zero is None:
            return [
                f"no displacements: --zero is {self.request.text}, and no sample with a pose came "
                "after that"
            ]
        return [f"zero: {self.zero_text}", *self.findings]

    def sentences(self) -> list[str]:
        """Sentences on the zero and the samples after the last sample."""
        return [*self.zero_sentences(), *self.tally.sentences(self.config)]


def unknown_displacements(solution: Solution) -> ObjectPose:
    """Displacements that are NaN, with the same parts of the covariance as the solution."""
    unknown = np.full((len(solution.status), 6, 6), np.nan)
    part = None if solution.calibration_covariance is None else unknown
    freedom = solution.calibration_degrees_of_freedom
    return ObjectPose(unknown[:, 0], None, unknown, part, part, True, freedom)


def retry(solution: Solution, solve: Any, ends: Any) -> None:
    """Solve lost samples again, each from the pose of the nearest solved sample of its piece, and
    replace their results in `solution`.

    solve: function that solves rows from starts.  ends: row after the last one of each piece.
    """
    is_lost, has_pose = np.isin(solution.status, LOST), solution.converged
    pairs, first = [np.empty((2, 0), np.intp)], 0
    for end in ends:
        lost, good = (first + np.flatnonzero(mask[first:end]) for mask in (is_lost, has_pose))
        if len(lost) and len(good):
            pairs.append(np.stack([lost, nearest(lost, good)]))
        first = end
    lost, good = np.concatenate(pairs, axis=1)
    if not len(lost):
        return
    repeated = solve(lost, solution.state[good])
    for item in fields(Solution):
        array = getattr(solution, item.name)
        if array is not None:  # there may be no covariances
            array[lost] = getattr(repeated, item.name)


def nearest(places: NDArray[np.intp], among: NDArray[np.intp]) -> NDArray[np.intp]:
    """The nearest of the ascending numbers `among` to each of `places`."""
    after = np.clip(np.searchsorted(among, places), 1, len(among) - 1) if len(among) > 1 else 0
    before = np.maximum(after - 1, 0)
    closer = places - among[before] <= among[after] - places
    return among[np.where(closer, before, after)]
