"""The page on the side of the run: one more process that subscribes to it."""

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

WIDE = (
    "warning: other machines can open this page, and anyone who has its address can read it; the "
    "connection is not encrypted"
)


class WebPage(Relay):
    """A page in the browsers of those who have its address.

    resume: lets a stopped stage move again, when somebody presses the page's button.  url: what to
    open; it has a token, without which nothing is served.
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
        """Raises `InputError` where `web`, [HOST:]PORT, is no address or cannot be used.

        status: gives what the run says of itself, in JSON's types.  more: what the page is to know
        beside the configuration.  drawn: the style and the scripts that draw the rig, by their
        names: `rig_scripts` of `facets.pictures.page.scripts`.
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
        if words.pop("resume", False):
            self.resume()
        super().hear(words)

    def greeting(self) -> list[str]:
        """What is to be said when it begins."""
        return [f"the page is at {self.url}", *([] if self.is_local else [WIDE])]


def description_of(config: Config) -> dict[str, Any]:
    """What a page must know of a configuration, beside the description of the samples."""
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
            {"name": name.upper(), "half": half, "least": least}
            for name, half, least in zip(
                DETECTORS, half_sizes(sensor).tolist(), least_light(sensor).tolist(), strict=True
            )
        ],
        "power": sensor.beam.power,
        "saturated": SATURATED,
    }
