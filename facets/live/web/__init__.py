"""A page on which a run is watched in a browser.

`page` stands on the side of the run: one more subscriber, which never keeps it waiting. `server` is
a process of its own that condenses samples (`bins`), decides who may look (`guard`) and feeds the
pages; what a browser loads lies in `assets` and `vendor`.
"""
