"""The page on the side of the run: one more subscriber, which never keeps it waiting."""

from __future__ import annotations

import json
import secrets
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ...core.names import ANGLES, DETECTORS, STATE
from ...detectors.counts import SATURATED
from ...detectors.noise import least_light
from ...estimation.solution import LABELS
from ...model.arrays import half_sizes
from ..streams.publication import MAX_WAITING_BYTES, Publication
from ..streams.sample_rows import row_content
from .guard import is_local, parse_address, place

if TYPE_CHECKING:
    from ...core.settings import Config

#: Time between two reports of the run's status to the page, s.
STATUS_INTERVAL_S = 0.25
#: The page's process may take this time to end, s.
END_TIMEOUT_S = 10.0
#: Samples are handed over to the page's process after this time at the latest, s.
HANDOVER_INTERVAL_S = 0.033
#: Samples are handed over at once where they are larger than this.
HANDOVER_BYTES = 500_000
#: Reports of the run's status may use this size beyond `MAX_WAITING_BYTES`, the limit of samples.
SPARE_BYTES = 1_000_000
WIDE = (
    "warning: other machines can open this page, and anyone who has its address can read it; the "
    "connection is not encrypted"
)


class WebPage(Publication):
    """A page in the browsers of those who have its address.

    status: gives what the run says of itself, in JSON's types.  resume: lets a stopped stage move
    again, when somebody presses the page's button.  url: what to open; it has a token,
    without which nothing is served.
    """

    def __init__(
        self,
        config: Config,
        web: str,
        status: Callable[[], dict[str, Any]],
        more: dict[str, Any],
        patient: bool = False,
        *,
        drawn: dict[str, str],
    ) -> None:
        """Raises `InputError` where `web`, [HOST:]PORT, is no address or cannot be used.

        more: what the page is to know beside the configuration.  drawn: the style and the scripts
        that draw the rig, by their names: `rig_scripts` of `facets.pictures.page.scripts`.
        """
        host, port = parse_address(web)
        token = secrets.token_urlsafe(18)
        self.status, self.due = status, 0.0
        self.resume: Callable[[], None] = lambda: None
        self.kept: list[bytes] = []
        self.size, self.next = 0, 0.0
        self.local = is_local(host)
        about = {**description_of(config), **more}
        scripts = {f"rig/{name}": text for name, text in drawn.items()}
        about["page"] = {"token": token, "host": host, "port": port, "drawn": scripts}
        super().__init__(f"http://{place(host, port)}", about, patient)
        self.address = f"http://{place(host, self.port or port)}"
        self.url = f"{self.address}/{token}/"

    def command(self) -> list[str]:
        return [sys.executable, "-m", "facets.live.web.server"]

    def hear(self, words: dict[str, Any]) -> None:
        if words.pop("resume", False):
            self.resume()
        else:
            super().hear(words)

    def last(self) -> float:
        """Pages are told of the end; that takes long only on a machine that is very busy."""
        return END_TIMEOUT_S

    def greeting(self) -> list[str]:
        """What is to be said when it begins."""
        return [f"the page is at {self.url}", *([] if self.local else [WIDE])]

    def send(self, data: bytes) -> None:
        """Rows of SAMPLE. They are kept for a moment: whenever the thread that hands them over is
        woken, the loop pays for it, and a page shows no more than some pictures a second.
        """
        self.kept.append(data)
        self.size += len(data)
        if self.patient or self.size > HANDOVER_BYTES or time.monotonic() >= self.next:
            self.flush()

    def flush(self) -> None:
        """Hands over what was kept."""
        self.next = time.monotonic() + HANDOVER_INTERVAL_S
        if self.kept:
            data = b"".join([b"S", *self.kept])
            self.kept.clear()
            self.size = 0
            super().send(data)

    def show(self) -> None:
        """Has the run say of itself how it goes, where it is time for that."""
        now = time.monotonic()
        if now >= self.next:
            self.flush()
        if now >= self.due:
            self.due = now + STATUS_INTERVAL_S
            self.tell(self.status())

    def tell(self, words: dict[str, Any]) -> None:
        """Hands over what the run says of itself; a newer one comes soon where there is no room."""
        data = b"J" + json.dumps(words).encode()
        with self.news:
            if self.trouble or self.ended or self.waiting > MAX_WAITING_BYTES + SPARE_BYTES:
                return
            self.queue.append(data)
            self.waiting += len(data)
            self.news.notify_all()

    def close(self) -> None:
        """Says that the run has ended, and ends the process. Never raises."""
        with suppress(Exception):
            self.flush()
            self.tell(self.status() | {"ended": "The run has ended."})
        super().close()


def description_of(config: Config) -> dict[str, Any]:
    """What a page must know of a configuration, beside the units of the columns."""
    sensor = config.sensor
    free = config.solve.beam == "free"
    return {
        "config": config.name,
        "config_sha256": config.sha256,
        "statuses": {str(number): words for number, words in LABELS.items()},
        **row_content(config),
        "components": [
            {
                "name": name,
                "unit": "mrad" if name in ANGLES else "mm",
                "fine": "µrad" if name in ANGLES else "µm",
                "shown": free or name not in ("bx", "by"),
            }
            for name in STATE
        ],
        "detectors": [
            {"name": name.upper(), "half": half, "least": least}
            for name, half, least in zip(
                DETECTORS, half_sizes(sensor).tolist(), least_light(sensor).tolist(), strict=True
            )
        ],
        "power": sensor.beam.power,
        "saturated": SATURATED,
    }
