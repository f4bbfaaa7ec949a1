"""The page of the paper's rig, which several files open in a browser."""

import numpy as np
import pytest
from browser import CHROMIUM, Browser

import facets
from facets.pictures import rig_page


@pytest.fixture(scope="session")
def address(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    path = tmp_path_factory.mktemp("page") / "rig.html"
    state = np.array([0, 0.03, 0, 0, 0, 0, 0, 0])
    path.write_text(rig_page(facets.Sensor(), "paper", state), "utf-8")
    return f"file://{path}"


@pytest.fixture(scope="module")
def flat(address):
    """The page without WebGL; its messages are looked at after the last test."""
    with Browser(address) as browser:
        browser.await_true("page.state() && page.point.scale > 0 && Boolean(page.take)")
        yield browser
        assert not browser.errors
