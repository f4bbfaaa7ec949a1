"""A page on which a run is watched in a browser.

`page` is the run's side of it: one more subscriber, which never keeps the run waiting. `server` is
a separate process that condenses samples (`bins`), decides who may look (`guard`) and feeds the
pages. The files that a browser loads are in `assets` and `vendor`.
"""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import replay_page as replay_page
else:
    __getattr__ = load_on_use(__name__)
