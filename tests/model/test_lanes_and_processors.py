"""The same bits in two, four and eight lanes, and from the code for other processors."""

import os
import platform
import subprocess
import sys

import pytest

from facets.model.object_code import host_features

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other processors"),
]
#: Prints the bytes of readings, derivatives and poses, of ideal light and of a bench's, with noise.
#: argument: how many lanes blocks have; 0 for those of the processor's registers.
SCRIPT = """
import sys
import numpy as np
from facets.model import object_code
if int(sys.argv[1]):
    object_code.vector_bits = lambda: 64 * int(sys.argv[1])
import facets
from facets.model.arrays import derivatives
rng = np.random.default_rng(5)
states = np.zeros((45, 8))
states[:, :6] = rng.uniform(-1, 1, (45, 6)) * [0.15, 0.15, 2, 8e-3, 8e-3, 8e-3]
noise = rng.normal(size=(45, 9)) * ([2.6e-3, 2.6e-3, 4e-5] * 3)
for name in ("paper", "bench-light"):
    sensor = facets.load(name).sensor
    readings = facets.readings(sensor, states)
    solution = facets.solve(sensor, readings + noise, beam="known")
    assert solution.converged.all()
    for found in (
        readings, facets.jacobian(sensor, states), derivatives(sensor, states),
        facets.parameter_jacobian(sensor, states), solution.state, solution.covariance,
        solution.residual, facets.solve(sensor, readings[0] + noise[0], beam="known").state,
    ):
        assert np.isfinite(found).all()
        print(found.tobytes().hex())
"""


def bits(processor: str, lanes: int) -> str:
    where = dict(os.environ)
    if processor:
        where["NUMBA_CPU_NAME"] = processor
    command = [sys.executable, "-c", SCRIPT, str(lanes)]
    return subprocess.run(command, env=where, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def usual() -> str:
    return bits("", 0)


@pytest.mark.parametrize(
    ("processor", "feature", "lanes"),
    [
        ("x86-64", "+sse2", 2),
        pytest.param("haswell", "+avx2", 4, marks=pytest.mark.study),
        pytest.param("znver3", "+avx2", 4, marks=pytest.mark.study),
        ("znver4", "+avx512f", 8),
    ],
)
def test_lanes_and_processors_do_not_change_bits(processor, feature, lanes, usual):
    if feature not in host_features().split(","):
        pytest.skip("this processor cannot run such code")
    assert bits(processor, lanes) == usual
