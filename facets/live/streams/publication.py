"""Every sample to other programs, while the record goes on as if there were none."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from ...core.version import __version__
from ...estimation.solution import LABELS
from ..run.pipeline import RunPoses
from ..run.pulses import PulseClock, pulse_columns
from ..run.sink import Sink
from ..sources.host_time import wall_clock_offset
from .addresses import check_address
from .outlet import RETRY_MS, Outlet, Relay
from .sample_rows import row_content, rows_of

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.measurement import Measurement

#: A replay waits up to this time for its first receivers, s.
FIRST_RECEIVER_WAIT_S = 20.0


def require_packages(addresses: Sequence[str] | None, web: str | None) -> None:
    """Raises `InputError` where a receiver, or the page, needs a package that is not installed."""
    for address in addresses or ():
        if address.startswith("lsl:"):
            require_extra("pylsl", address)
    if web is not None:
        require_extra("aiohttp", "--web")


class Publications(ClosedAtExit, Sink):
    """All the addresses that samples go to; in a `with` statement they are closed at its end.

    utc_offset: of the wall clock over the host's monotonic one, s; now, if it is not given.
    """

    def __init__(
        self,
        addresses: Sequence[str],
        config: Config,
        patient: bool = False,
        utc_offset: float | None = None,
        objects: Measurement | None = None,
    ) -> None:
        """Raises `InputError` for an address that cannot be used; none is then open.

        objects: which point's poses there are, as of `row_content`.
        """
        about: dict[str, Any] = {
            "config": config.name,
            "config_sha256": config.sha256,
            "facets": __version__,
            "statuses": {str(number): words for number, words in LABELS.items()},
            **row_content(config, objects),
        }
        self.offset = wall_clock_offset() if utc_offset is None else utc_offset
        self.pulses = PulseClock() if config.acquire.mark == "pps" else None
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
        """The addresses, with the port where the system has chosen one."""
        return [one["address"] for one in self.counts()]

    def await_receivers(self) -> None:
        """Wait until there is a receiver at each address, for up to `FIRST_RECEIVER_WAIT_S`."""
        last = time.monotonic() + FIRST_RECEIVER_WAIT_S
        while time.monotonic() < last and any(one["receivers"] == 0 for one in self.counts()):
            self.outlet.hear(RETRY_MS)

    def add_poses(self, poses: RunPoses) -> None:
        """Publish poses at every address."""
        rows = rows_of(poses, self.offset)
        if self.pulses is not None:
            utc = pulse_columns(poses, self.offset, self.pulses)["utc_s"]
            rows["utc_s"] = np.where(np.isfinite(utc), utc, rows["utc_s"])
        self.outlet.send(rows)

    def close(self) -> None:
        self.outlet.close()

    def messages(self) -> list[str]:
        return [
            f"{one['address']}: publishing has ended: {one['trouble']}"
            for one in self.counts()
            if one["trouble"]
        ]

    def values(self) -> dict[str, Any]:
        return {"published": self.counts()}

    def counts(self) -> list[dict[str, Any]]:
        """What became of the samples, address by address."""
        self.outlet.hear()
        own = [self.outlet.counts()] if self.outlet.places else []
        return [*own, *(relay.counts() for relay in self.outlet.relays)]

    def sentences(self) -> list[str]:
        """A line for each address, for the end."""
        found = []
        for one in self.counts():
            text = f"{one['address']}: {one['sent']} samples published, {one['dropped']} dropped"
            found.append(f"{text} ({one['trouble']})" if one["trouble"] else text)
            if self.pulses is not None:
                found.append(f"{one['address']}: {self.pulses.sentence}")
        return found
