"""Poses of the measured object beside those of the mirror, sample by sample."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ...core.units import Booleans, Floats, Integers
from ...estimation.object_pose import ObjectPose
from ...estimation.solution import Status, empty_solution
from ...estimation.table import object_columns, result_columns
from ...estimation.zero import ZeroRequest, zero_findings, zero_of_samples, zero_of_table, zero_text

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.differences import ZeroPose
    from ...estimation.solution import Solution

US_PER_S = 1e6


class ObjectPoses:
    """The columns of the object, of its displacements from a zero, and of covariances.

    zero: the reference pose, None until it is measured.  news: what happened to the zero since
    somebody took the news.  findings: what a user of the zero should know, in sentences.
    """

    def __init__(
        self, config: Config, request: ZeroRequest | None = None, covariance: bool = False
    ) -> None:
        """request: the samples of the zero, if displacements are wanted.  covariance: whether the
        whole covariances are columns, too.  Raises `InputError` where a zero's table is of no
        use."""
        self.config, self.request, self.covariance = config, request, covariance
        self.zero: ZeroPose | None = None
        self.news: list[str] = []
        self.findings: list[str] = []
        #: Of the zero's samples so far: states, temperatures, and detectors.
        self.members: list[tuple[Floats, Floats, Booleans]] = []
        self.first: tuple[int, float] | None = None  # number and time of the first fitting sample
        if request is not None and request.file is not None:
            self.fix(zero_of_table(request.file, config, config.solve))

    @property
    def is_needed(self) -> bool:
        return self.config.object is not None or self.request is not None or self.covariance

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The columns."""
        nothing = empty_solution(1, Status.NON_FINITE, self.config.sensor.calibration is not None)
        return tuple(self.columns(nothing, np.zeros(1, np.int64), np.zeros(1, np.int64)))

    def description(self) -> dict[str, Any]:
        """What receivers of the columns are told: the point, the orientation, the zero, the
        columns."""
        body = self.config.object
        return {
            "object": None if body is None else {
                "point_mm": list(body.point),
                "orientation_deg": np.degrees(body.orientation).tolist(),
            },
            "zero": None if self.request is None else self.request.text,
            "covariance": self.covariance,
            "object_columns": list(self.names),
        }  # fmt: skip

    @property
    def is_measuring(self) -> bool:
        """Whether a zero is requested and not measured yet."""
        return self.request is not None and self.zero is None

    def columns(
        self,
        solution: Solution,
        seq: Integers,
        time: Integers,
        temperature: Floats | None = None,
    ) -> dict[str, Floats]:
        """The columns of samples (n,); displacements are NaN until the zero is measured.

        seq: (n,) numbers of the samples.  time: (n,) the board's, us.  temperature: (n,) degrees
        Celsius, if the sensor follows it.
        """
        if not self.is_needed:
            return {}
        members = None
        if self.is_measuring:
            members = self.collect(solution, seq, time / US_PER_S, temperature)
        columns = object_columns(
            solution, self.config.object, self.zero, members=members, temperature=temperature,
            covariance=self.covariance,
        )  # fmt: skip
        if self.is_measuring:
            columns |= result_columns(
                unknown_displacements(solution), "displacement_", self.covariance
            )
        return columns

    def collect(
        self, solution: Solution, seq: Integers, time: Floats, temperature: Floats | None
    ) -> Booleans:
        """Add samples to the zero; make it when the first sample after them has come. Returns which
        samples belong to it."""
        assert self.request is not None
        ok = solution.ok
        if self.first is None:
            if not ok.any():
                return ok
            start = int(np.argmax(ok))
            self.first = int(seq[start]), float(time[start])
        number, start_time = self.first
        inside = self.request.members(seq - number + 1, time, start_time)
        members: Booleans = inside & ok
        if members.any():
            known = np.empty(0) if temperature is None else temperature[members]
            self.members.append((solution.state[members], known, solution.used[members]))
        ahead = inside[seq >= number]
        if self.members and len(ahead) and (self.request.row or not ahead[-1]):
            self.measure()
        return members

    def measure(self) -> None:
        """Make the zero of the samples so far; begin again where they are of no use."""
        states, temperature, used = map(np.concatenate, zip(*self.members, strict=True))
        self.members, self.first = [], None
        try:
            self.fix(zero_of_samples(self.config, self.config.solve, states, temperature, used))
        except InputError as error:
            self.news.append(f"is measured again: {error}")

    def fix(self, zero: ZeroPose) -> None:
        assert self.request is not None
        self.zero, self.findings = zero, zero_findings(zero)
        self.news += [zero_text(self.request, zero), *self.findings]

    def take_news(self) -> list[str]:
        """What happened to the zero since the last call."""
        news, self.news = self.news, []
        return news

    def messages(self) -> list[str]:
        """What a person should know now."""
        if self.is_measuring and self.first is not None:
            return ["the zero is being measured: keep the mirror still"]
        if self.is_measuring:
            return ["the zero waits for a pose that fits its readings; there is none yet"]
        return self.findings

    def sentences(self) -> list[str]:
        """What is said of the zero at the end of a run."""
        if self.request is None:
            return []
        if self.zero is None:
            return [
                f"no displacements: --zero is {self.request.text}, and no sample with a pose came "
                "after that"
            ]
        return [f"zero: {zero_text(self.request, self.zero)}", *self.findings]


def unknown_displacements(solution: Solution) -> ObjectPose:
    """Displacements that are not known, with the parts that the solution's covariance has."""
    unknown = np.full((len(solution.status), 6, 6), np.nan)
    part = None if solution.calibration_covariance is None else unknown
    return ObjectPose(unknown[:, 0], None, unknown, part, part, True)
