"""A page on which a run is watched in a browser.

`page` stands on the side of the run: one more subscriber, which never keeps it waiting. `server` is
a process of its own that condenses samples (`bins`), decides who may look (`guard`) and feeds the
pages; what a browser loads lies in `assets` and `vendor`.
"""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import replay_page as replay_page
else:
    __getattr__ = load_on_use(__name__)
