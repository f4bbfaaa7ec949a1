"""Two halves of the samples agree but for chance, unless something changed between them."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import NOMINAL, read, sample_motion

from facets.calibration import PLACE, Remainder, assign_values, compare_halves, fit, half_findings


def halves_of(seed, change=0.0):
    """The halves of a rig one of whose facets turns in the middle, rad."""
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    data, _ = sample_motion(rig, 80, rng)
    values = rig.values.copy()
    values[PLACE["facet_a.inclination"]] += change
    later = read(rigs.Rig(assign_values(NOMINAL, values), values), data, rng)
    data = data._replace(raw=np.concatenate([data.raw[:40], later[40:]]))
    fitted = fit.fit(NOMINAL, data, rigs.choice(), None)
    return compare_halves(Remainder(NOMINAL, data, fitted, None))


def test_chance_alone_makes_the_differences_of_halves():
    """Least of six axes and two ways to halve: uniform, if the axes were independent."""
    chances = [half.least_chance for seed in range(8) for half in halves_of(seed)]
    assert min(chances) > 1e-3
    assert np.median(chances) > 0.2


@pytest.mark.parametrize("change", [2e-5, -2e-5])
def test_what_changed_between_the_halves_is_seen(change):
    by_time, interleaved = halves_of(3, change)
    (finding,) = half_findings([by_time, interleaved])
    assert finding.bad
    assert "first and the second half" in finding.words
    assert interleaved.least_chance > 1e-3
