"""The page of a run, seen from the run: one more process that subscribes to it."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ...core.names import ANGLES, DETECTORS, STATE
from ...detectors.counts import SATURATED
from ...detectors.noise import least_light
from ...model.arrays import half_sizes
from ..streams.outlet import Outlet, Relay
from .guard import is_local, parse_address, place

if TYPE_CHECKING:
    from ...core.settings import Config

#: The warning about a page that other machines can open.
OPEN_TO_OTHERS = (
    "warning: other machines can open this page, and anyone who has its address can read it; the "
    "connection is not encrypted"
)


class WebPage(Relay):
    """A page in the browsers of those who have its address.

    resume: called when a person presses the page's button that resumes a stopped stage.
    url: address for a browser; it has a token, without which nothing is served.
    """

    def __init__(
        self,
        outlet: Outlet,
        config: Config,
        web: str,
        status: Callable[[], dict[str, Any]],
        more: dict[str, Any],
        *,
        drawn: dict[str, str],
    ) -> None:
        """Start the page's process.  Raises `InputError` for an address that cannot be used.

        web: the address `[HOST:]PORT`.  status: returns the status of the run, in JSON's types.
        more: entries for the page in addition to the description of the configuration.  drawn: the
        style and the scripts that draw the rig, by their names: `rig_scripts` of
        `facets.pictures.page.scripts`.
        """
        host, port = parse_address(web)
        token = secrets.token_urlsafe(18)
        self.resume: Callable[[], None] = lambda: None
        self.is_local = is_local(host)
        scripts = {f"rig/{name}": text for name, text in drawn.items()}
        setup = {
            "about": {**description_of(config), **more},
            "page": {"token": token, "host": host, "port": port, "drawn": scripts},
        }
        super().__init__(f"http://{place(host, port)}", outlet, "facets.live.web.server", setup)
        self.port = int(self.said["port"])
        self.address = f"http://{place(host, self.port)}"
        self.url = f"{self.address}/{token}/"
        outlet.status = status

    def hear(self, words: dict[str, Any]) -> None:
        """Take in a reply of the page's process; a request of a page resumes the stage."""
        if words.pop("resume", False):
            self.resume()
        super().hear(words)

    def greeting(self) -> list[str]:
        """Return the sentences for the user when the page begins."""
        return [f"the page is at {self.url}", *([] if self.is_local else [OPEN_TO_OTHERS])]


def description_of(config: Config) -> dict[str, Any]:
    """Describe a configuration for a page, in addition to the description of the samples."""
    sensor = config.sensor
    free = config.solve.beam == "free"
    return {
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
            {"name": name.upper(), "half": half, "least": floor}
            for name, half, floor in zip(
                DETECTORS, half_sizes(sensor).tolist(), least_light(sensor).tolist(), strict=True
            )
        ],
        "power": sensor.beam.power,
        "saturated": SATURATED,
    }
