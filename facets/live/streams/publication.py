"""Publish every sample for other programs, which never hold back the recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from ...core.version import __version__
from ...estimation.solution import LABELS
from ..run.pipeline import RunPoses
from ..run.sink import Sink
from ..sources.host_time import wall_clock_offset
from .addresses import check_address
from .outlet import Outlet, Relay
from .sample_rows import row_content, rows_of

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.measurement import Measurement


def require_packages(addresses: Sequence[str] | None, web: str | None) -> None:
    """Raise `InputError` if a receiver, or the page, needs a package that is not installed."""
    for address in addresses or ():
        if address.startswith("lsl:"):
            require_extra("pylsl", address)
    if web is not None:
        require_extra("aiohttp", "--web")


class Publications(ClosedAtExit, Sink):
    """The addresses at which samples are published; a `with` statement closes them at its end.

    Parameters
    ----------
    addresses : sequence of str
        `zmq://HOST:PORT`, `udp://HOST:PORT` or `lsl:NAME`.
    config : Config
        Configuration of the sensor and the stream.
    patient : bool
        Whether to wait for subscribers that are slow, as a replay does.
    utc_offset : float, optional
        The wall clock's time less the host's monotonic time, s; the present one by default.
    objects : Measurement, optional
        The measurement that gives the columns of the object; that of the configuration by default.

    Attributes
    ----------
    outlet : Outlet
        The socket that sends the samples, and its processes.

    Raises
    ------
    InputError
        If an address cannot be used; none is then open.
    """

    def __init__(
        self,
        addresses: Sequence[str],
        config: Config,
        patient: bool = False,
        utc_offset: float | None = None,
        objects: Measurement | None = None,
    ) -> None:
        about: dict[str, Any] = {
            "config": config.name,
            "config_sha256": config.sha256,
            "facets": __version__,
            "statuses": {str(number): words for number, words in LABELS.items()},
            **row_content(config, objects),
        }
        self.offset = wall_clock_offset() if utc_offset is None else utc_offset
        for address in addresses:
            check_address(address)
        self.outlet = Outlet(about, patient)
        try:
            for address in addresses:
                if address.startswith("zmq:"):
                    self.outlet.open(address)
                else:
                    Relay(address, self.outlet, "facets.live.streams.senders", {})
        except BaseException:
            self.close()
            raise

    def places(self) -> list[str]:
        """Return the addresses, with the ports that the system has chosen."""
        return [target["address"] for target in self.counts()]

    def add_poses(self, poses: RunPoses) -> None:
        """Publish poses at all addresses."""
        self.outlet.send(rows_of(poses, self.offset))

    def refresh(self) -> None:
        """Take in the receivers' messages, and publish the run's status if it is due."""
        self.outlet.refresh()

    def close(self) -> None:
        self.outlet.close()

    def messages(self) -> list[str]:
        """A sentence for each receiver to which publishing has ended."""
        return [
            f"{target['address']}: publishing has ended: {target['trouble']}"
            for target in self.counts()
            if target["trouble"]
        ]

    def values(self) -> dict[str, Any]:
        """The entry of a status: the counts of each receiver."""
        return {"published": self.counts()}

    def counts(self) -> list[dict[str, Any]]:
        """Return the counts of samples: of all `zmq://` addresses together, and of each process."""
        self.outlet.hear()
        zmq_counts = [self.outlet.counts()] if self.outlet.places else []
        return [*zmq_counts, *(relay.counts() for relay in self.outlet.relays)]

    def sentences(self) -> list[str]:
        """Return the sentences for the end of a run, with the counts of each address."""
        sentences = []
        for target in self.counts():
            address, trouble = target["address"], target["trouble"]
            text = f"{address}: {target['sent']} samples published, {target['dropped']} dropped"
            sentences.append(f"{text} ({trouble})" if trouble else text)
        return sentences
