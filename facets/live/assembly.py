"""Assemble a run from a configuration: a source, the loop that solves, and the sinks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Self

from ..config.loading import fingerprint
from ..core.errors import InputError
from ..core.keys import block_of
from ..core.rigid_body import MIRROR, MeasuredObject
from ..estimation.zero import PoseColumns
from ..files.provenance import run_record
from ..files.whole import hold_signals
from ..tracking.check import StageCheck
from ..tracking.control import Law
from ..tracking.tracker import Tracker
from .recording.writer import Recording
from .run.live import Live
from .run.loop import Ending, acquire
from .run.pipeline import Pipeline
from .run.reader import Reader
from .sources.ports import VIRTUAL
from .stage_setup import (
    check_sentences,
    open_envelope,
    refuse_board,
    require_stability,
    require_stage_check,
)
from .streams.publication import Publications, require_packages
from .virtual.in_process import BenchInProcess, BenchReader
from .web.page import WebPage
from .web.status import status_of

if TYPE_CHECKING:
    from ..core.settings import Config

OnProgress = Callable[[str], None]
Show = Callable[[Live], None]


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a run in addition to reading and solving.

    Attributes
    ----------
    record, folder
        Whether the run is recorded, and the new folder for the recording; `recordings/TIME` by
        default.
    track, check_stage
        Whether the stage follows the mirror, or moves for a check of its wiring; not both. If
        neither is set, the stage never moves.
    stage_port
        Port of the stage; `stage.port` of the configuration by default.
    seconds, samples
        The run ends after this time, s, or after this number of samples.
    reconnect
        Whether the run waits for an unplugged board.
    max_loss, compare
        Largest fraction of lost samples or of silence in a good run, and whether poses that differ
        from the board's poses make a run bad.
    publish
        Addresses at which samples are published.
    web, page_scripts
        Address `[HOST:]PORT` of a page that shows the run, and the scripts that draw the rig on it:
        `facets.pictures.page.scripts.rig_scripts(config.sensor)`.
    columns
        Further columns of the poses, such as displacements from a zero.

    Raises
    ------
    InputError
        For options that contradict each other.
    """

    record: bool = True
    folder: Path | None = None
    track: bool = False
    check_stage: bool = False
    stage_port: str | None = None
    seconds: float | None = None
    samples: int | None = None
    reconnect: bool = False
    max_loss: float = 0.001
    compare: bool = False
    publish: Sequence[str] = ()
    web: str | None = None
    page_scripts: dict[str, str] | None = None
    columns: PoseColumns = field(default_factory=PoseColumns)

    def __post_init__(self) -> None:
        if self.check_stage and self.track:
            raise InputError("--check-stage and --track both move the stage; check it first")
        if self.seconds == 0:
            raise InputError(
                "--seconds 0 would end at once; give more, or leave the option out to run until "
                "Ctrl-C"
            )

    @property
    def moves_stage(self) -> bool:
        """Whether the run moves a stage: to follow the mirror, or to check the wiring."""
        return self.track or self.check_stage


@dataclass
class Run:
    """A live stream that is recorded, solved, published, and followed by a stage.

    `from_config` assembles a run and opens its parts; `acquire` runs to the end and closes them.

    Attributes
    ----------
    live : Live
        The state of the run, at any time: counts, the newest poses, messages.
    recording : Recording or None
        The files of the recording.
    check : StageCheck or None
        The check of the stage's wiring, if the run has one.

    Examples
    --------
    >>> import facets
    >>> from facets.live import Run
    >>> run = Run.from_config(facets.load("bench"), "file:bytes.bin")  # doctest: +SKIP
    >>> run.acquire()  # doctest: +SKIP
    >>> run.live.pipeline.tally.samples  # doctest: +SKIP
    10000
    """

    config: Config
    options: RunOptions
    live: Live
    ending: Ending = field(default_factory=Ending)
    reader: Reader | None = None
    recording: Recording | None = None
    publications: Publications | None = None
    stage_port: str = ""

    @classmethod
    def from_config(
        cls,
        config: Config,
        port: str | None = None,
        options: RunOptions | None = None,
        on_progress: OnProgress = lambda _: None,
    ) -> Self:
        """Open the source, the recording, the publications, the page and the stage of a run.

        Parameters
        ----------
        config : Config
            Sensor, solver, stream and stage.
        port : str, optional
            Port of the detector board; `acquire.port` of the configuration by default.
        options : RunOptions, optional
            Recording, publication, stage and end of the run; it is recorded by default.
        on_progress : callable
            Receives messages for the user at the beginning, line by line.

        Raises
        ------
        InputError
            For an address or a folder that cannot be used.
        PortError
            If the board or the stage cannot be opened. All parts opened before are then closed
            again, and an empty recording is removed.
        """
        options = options or RunOptions()
        if config.acquire.mark == "pps":
            on_progress("acquire.mark: pps has no effect; leave it out of the configuration")
        port = require_port(port or config.acquire.port, "--port", "acquire.port")
        if options.moves_stage:
            refuse_board(config, port)
        bench = open_bench(port, config, options)
        if options.check_stage:  # the check uses only the readings' place of the beam
            config = replace(config, solve=replace(config.solve, beam="free"))
        require_packages(options.publish, options.web)
        config = resolve_object(config)
        run = cls(config, options, prepare_live(config, options.columns, bench))
        with ExitStack() as on_failure:
            on_failure.callback(run.abandon)
            if options.record:
                run.begin_recording()
            page = run.publish(on_progress)
            if options.moves_stage:
                run.open_stage(bench, page, on_progress)
            run.open_reader(port, bench, on_progress)
            on_failure.pop_all()
        run.ending = Ending(options.seconds or inf, options.samples or inf, run.is_check_over)
        return run

    @property
    def check(self) -> StageCheck | None:
        """The check of the stage's wiring, None if the run has none."""
        tracker = self.live.tracker
        return tracker if isinstance(tracker, StageCheck) else None

    def is_check_over(self) -> bool:
        """Whether the run has a check of the stage that is complete or was stopped."""
        return self.check is not None and self.check.is_over

    def begin_recording(self) -> None:
        """Begin a recording in a new folder."""
        now = datetime.now(UTC)
        folder = self.options.folder or Path("recordings") / now.strftime("%Y%m%d-%H%M%S")
        begin = {"begin_utc": now.isoformat(), "begin_monotonic": self.live.clock()}
        if (zero := self.live.pipeline.measurement.request) is not None:
            begin["zero"] = zero.text
        meta = run_record(self.config, None, 0.0, begin)
        with hold_signals():  # a folder that is begun has an owner, who removes it
            self.recording = Recording(folder, meta, self.config.resolved, self.config.acquire.sync)
        self.live.sinks.append(self.recording)

    def publish(self, on_progress: OnProgress) -> WebPage | None:
        """Begin to publish samples, and report where; return the page, None if there is none.
        Raises `InputError` for a page without scripts."""
        options, measurement = self.options, self.live.pipeline.measurement
        if not options.publish and options.web is None:
            return None
        self.publications = Publications(options.publish, self.config, objects=measurement)
        self.live.sinks.append(self.publications)
        if options.publish:
            on_progress(f"publishing at {', '.join(self.publications.places())}")
        if options.web is None:
            return None
        if options.page_scripts is None:
            raise InputError("a page (web) needs page_scripts; give rig_scripts of the sensor")
        status = partial(status_of, self.live)
        outlet, more = self.publications.outlet, {"kind": "acquire"}
        page = WebPage(outlet, self.config, options.web, status, more, drawn=options.page_scripts)
        for text in page.greeting():
            on_progress(text)
        outlet.refresh()
        return page

    def open_stage(
        self, bench: BenchInProcess | None, page: WebPage | None, on_progress: OnProgress
    ) -> None:
        """Open the stage, which the page can then resume. Raises an error if the stage is
        unsafe."""
        config, check, say = self.config, self.options.check_stage, self.live.add_event
        port = "virtual" if bench else self.options.stage_port or config.stage.port
        self.stage_port = require_port(port, "--stage-port", "stage.port")
        if not (check or bench):
            require_stage_check(config, self.stage_port)
        require_stability(config, on_progress)
        law = Law.from_sensor(config.sensor, config.stage)
        envelope = open_envelope(config.stage, self.stage_port, bench, not check, say)
        self.live.tracker = StageCheck(envelope, law) if check else Tracker(envelope, law)
        if page:
            page.resume = partial(self.live.tracker.resume, "the page")

    def open_reader(self, port: str, bench: BenchInProcess | None, on_progress: OnProgress) -> None:
        """Open the detector board's port."""
        if bench:
            self.reader = BenchReader(bench, self.config, self.live)
        else:
            self.reader = Reader(self.config, port, self.options.reconnect, self.live, on_progress)

    def abandon(self) -> None:
        """Close the parts of a run that does not begin, and remove its empty recording."""
        with ExitStack() as closing:
            if self.recording is not None:
                closing.callback(self.recording.discard)
            if self.live.tracker is not None:
                closing.callback(self.live.tracker.close)
            if self.publications is not None:
                closing.callback(self.publications.close)
            if self.reader is not None:
                closing.callback(self.reader.close_port)

    def acquire(self, show: Show = lambda _: None) -> None:
        """Run to the end of the stream, the time or the samples, or to ^C; then close all parts.

        show: called often, with the state of the run. Raises the `FacetsError` that ended the
        reading, if there is one; everything before it is recorded and solved.
        """
        assert self.reader is not None
        acquire(self.live, self.reader, self.ending, show, self.complaints)

    def complaints(self) -> list[str]:
        """Return the faults of a finished run, in sentences; none for a good run."""
        live, sentences = self.live, self.sample_complaints()
        if live.pipeline.tally.misfit.is_mostly_flagged:
            sentences.append(live.pipeline.tally.misfit.sentence)
        if live.pipeline.measurement.is_measuring:
            sentences.append(f"{live.pipeline.measurement.zero_sentences()[0]}.")
        if self.options.compare:
            sentences += live.pipeline.board.complaints()
        if self.check:
            return sentences + self.check.faults()
        if live.tracker and live.tracker.searching:
            sentences.append("the run ended in a search for the mirror, which was not found.")
        if live.stage_stop:
            sentences.append(f"the stage was stopped and not resumed: {live.stage_stop}")
        if self.recording:
            sentences += [f"{text}." for text in self.recording.messages()]
        return sentences

    def sample_complaints(self) -> list[str]:
        """Return the faults of the samples of a finished run, in sentences."""
        live, without = self.live, self.live.time_without_samples
        sentences = [text for text in (live.pipeline.tally.pose_complaint(),) if text]
        if clock := live.pipeline.times.fault:
            sentences.append(f"{clock}.")
        if live.loss > self.options.max_loss:
            silence = f" and none came for {without:.1f} s" if without else ""
            sentences.append(
                f"{live.pipeline.sequence.lost} samples were lost{silence}, {100 * live.loss:.3g} "
                f"% of all; --max-loss allows {100 * self.options.max_loss:.3g} %."
            )
        return sentences

    def check_sentences(self, path: Path | None) -> Iterator[str]:
        """Yield the results of the stage's check, and write the checked configuration to path."""
        if self.check:
            good = not self.complaints()
            yield from check_sentences(self.check, self.config, self.stage_port, path, good)


def prepare_live(config: Config, columns: PoseColumns, bench: BenchInProcess | None) -> Live:
    """Prepare the solver, and the clock: only that of a virtual bench is not the host's."""
    live = Live(Pipeline(config, columns))
    if bench:
        live.clock = bench.clock
    live.pipeline.warm_up()
    return live


def resolve_object(config: Config) -> Config:
    """Return the configuration with its object in its keys.

    The object may come from --point; with it in the recording, a replay solves for the same point.
    """
    keys = block_of(MeasuredObject).write(config.resolved["object"], config.object or MIRROR)
    if keys == config.resolved["object"]:
        return config
    resolved = config.resolved | {"object": keys}
    return replace(config, resolved=resolved, sha256=fingerprint(resolved))


def open_bench(port: str, config: Config, options: RunOptions) -> BenchInProcess | None:
    """Make the virtual bench that a port names, None for another port; no stage but that of the
    bench may then move. Raises `InputError` if a port of a stage is given, too."""
    if not port.startswith(VIRTUAL):
        return None
    if options.stage_port:
        raise InputError(f"--stage-port: {port} has a stage of its own; leave the option out")
    return BenchInProcess(port, config)


def require_port(port: str | None, option: str, key: str) -> str:
    """Return the port; raise `InputError` if there is none."""
    if not port:
        raise InputError(
            f"no port is given: use {option}, or set {key} in the configuration; without hardware, "
            "--port virtual:MOTION simulates the board and the stage"
        )
    return port
