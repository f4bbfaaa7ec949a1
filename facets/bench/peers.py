"""The same sensor in other packages: `pip install "facets-6dof[bench-peers]"`.

Mitsuba 3 and Optiland trace random rays; JAX evaluates the Gauss-Legendre form of `rivals`, and
optimistix and jaxopt solve it. Written as their manuals suggest, for the paper's sensor. A package
that is not installed is left out.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats
from . import rivals
from .clock import Contender

SCALE = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1])
NODES = 12


#: The packages of the extra.
PACKAGES = ("jax", "optimistix", "jaxopt", "mitsuba", "optiland")


def missing(*packages: str) -> list[str]:
    return [name for name in packages if importlib.util.find_spec(name) is None]


def forward(quick: bool, seed: int) -> list[Contender]:
    """Contenders for readings, for the installed packages."""
    rays = 2**14 if quick else 2**20
    points = rivals.random_points(rays, seed)
    made = []
    if not missing("jax"):
        made.append(Contender(f"JAX vmap of Gauss-Legendre {NODES}", jax_readings(), 1000))
        made.append(Contender("JAX jacfwd of the same", jax_jacobian(), 1000))
    if not missing("mitsuba"):
        made.append(Contender(f"{rays} rays in Mitsuba 3", mitsuba_tracer(points), 2))
    if not missing("optiland"):
        made.append(Contender(f"{rays} rays in Optiland", optiland_tracer(points), 2))
    return made


def inverse(quick: bool) -> list[Contender]:
    """Contenders for poses from readings."""
    poses = 100 if quick else 1000
    made = []
    if not missing("jax", "optimistix"):
        made.append(Contender("optimistix Levenberg-Marquardt", optimistix_solver(), poses))
    if not missing("jax", "jaxopt"):
        made.append(Contender("jaxopt Levenberg-Marquardt", jaxopt_solver(), poses))
    return made


def jax_model() -> Callable[[Any], Any]:
    """state (8,) to readings (9,), in JAX."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    places, weights = np.polynomial.legendre.leggauss(NODES)
    resting = rivals.SLOPE * (rivals.OUTWARD - rivals.DOWN)

    def model(state: Any) -> Any:
        (cr, cp, cy), (sr, sp, sy) = jnp.cos(state[3:6]), jnp.sin(state[3:6])
        turn = jnp.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        normals = resting @ turn.T
        edges = jnp.cross(normals, jnp.roll(normals, 1, axis=0))
        start = jnp.arctan2(edges[:, 1], edges[:, 0])
        opening = (jnp.roll(start, -1) - start) % (2 * jnp.pi)
        angle = start[:, None] + opening[:, None] * (places + 1) / 2
        ux, uy = jnp.cos(angle), jnp.sin(angle)
        q = (state[:2] - state[6:]) / rivals.SIGMA
        a, h = q[0] * ux + q[1] * uy, q[0] * uy - q[1] * ux
        zeroth = jnp.exp(-h * h / 2) * jax.scipy.special.erfc(a / np.sqrt(2))
        zeroth /= 2 * np.sqrt(2 * np.pi)
        first = jnp.exp(-(a * a + h * h) / 2) / (2 * np.pi) - a * zeroth
        second = zeroth - a * first
        share = opening[:, None] / 2 * weights
        mass = (share * first).sum(-1)
        x = (share * (q[0] * first + second * ux)).sum(-1) / mass
        y = (share * (q[1] * first + second * uy)).sum(-1) / mass
        start = jnp.stack([x, y, 0 * x], axis=1) * rivals.SIGMA
        start += jnp.array([state[6], state[7], 0])
        down = normals[:, 2]
        hit = start.at[:, 2].add(((start - state[:3]) * normals).sum(-1) / -down)
        leaving = jnp.array(rivals.DOWN) + 2 * down[:, None] * normals
        outward, sideways = jnp.array(rivals.OUTWARD), jnp.array(rivals.SIDEWAYS)
        radius = rivals.SENSOR.psds[0].radius
        flight = (radius - (hit * outward).sum(-1)) / (leaving * outward).sum(-1)
        spot = hit + flight[:, None] * leaving
        psi = (spot * sideways).sum(-1)
        return jnp.stack([psi, spot[:, 2], rivals.POWER * mass], axis=1).ravel()

    return model


def jax_readings() -> Callable[[Floats], Floats]:
    import jax

    batch = jax.jit(jax.vmap(jax_model()))
    return lambda states: np.asarray(batch(states))


def jax_jacobian() -> Callable[[Floats], Floats]:
    import jax

    batch = jax.jit(jax.vmap(jax.jacfwd(jax_model())))
    return lambda states: np.asarray(batch(states))


def residual() -> Callable[[Any, Any], Any]:
    """Nine readings less those of a scaled state, each in units of its own size."""
    model = jax_model()
    size = np.array([1, 1, 0.1] * 3)
    return lambda x, xi: (model(x * SCALE) - xi) / size


def optimistix_solver() -> Callable[[Floats], Floats]:
    import jax
    import optimistix

    fun, method = residual(), optimistix.LevenbergMarquardt(rtol=1e-12, atol=1e-12)

    def solve(xi: Any) -> Any:
        return optimistix.least_squares(
            fun, method, np.zeros(8), args=xi, max_steps=30, throw=False
        ).value

    batch = jax.jit(jax.vmap(solve))
    return lambda rows: np.asarray(batch(rows[:, :9])) * SCALE


def jaxopt_solver() -> Callable[[Floats], Floats]:
    import jax
    import jaxopt

    method = jaxopt.LevenbergMarquardt(residual(), maxiter=30, tol=1e-12, materialize_jac=True)
    batch = jax.jit(jax.vmap(lambda xi: method.run(np.zeros(8), xi).params))
    return lambda rows: np.asarray(batch(rows[:, :9])) * SCALE


def mine(state: Floats, points: Floats) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Rays through points of the beam, (n, 3) at z = 0, which facet each meets, and the normals."""
    normals = rivals.facet_normals(state)
    start = np.zeros((len(points), 3))
    start[:, :2] = state[6:] + rivals.SIGMA * points
    return start, (((state[:3] - start) @ normals.T) / (normals @ rivals.DOWN)).argmax(1), normals


def reading_of(spots: list[Floats], total: int) -> list[float]:
    out: list[float] = []
    for spot in spots:
        out += [*spot.mean(axis=0), rivals.POWER * len(spot) / total]
    return out


def optiland_tracer(points: Floats) -> Callable[[Floats], Floats]:
    """A mirror and a detector placed in space for each facet."""
    from optiland.optic import Optic
    from optiland.rays import RealRays
    from scipy.spatial.transform import Rotation

    def system(state: Floats, k: int) -> Any:
        azimuth = float(rivals.AZIMUTHS[k])
        turn = Rotation.from_euler("ZYX", state[[5, 4, 3]])
        facet = turn * Rotation.from_euler("ZY", [azimuth, np.pi / 4])
        rz, ry, rx = facet.as_euler("ZYX")
        optic, radius = Optic(), rivals.SENSOR.psds[k].radius
        optic.add_surface(index=0, z=50.0)
        x, y, z = state[:3]
        optic.add_surface(
            index=1, x=x, y=y, z=z, rx=rx, ry=ry, rz=rz, material="mirror", is_stop=True
        )
        optic.add_surface(
            index=2, x=radius * np.cos(azimuth), y=radius * np.sin(azimuth), z=0.0,
            ry=np.pi / 2, rz=azimuth,
        )  # fmt: skip
        return optic

    def one(state: Floats) -> list[float]:
        start, facet, _ = mine(state, points)
        spots = []
        for k in range(3):
            x, y, z = start[facet == k].T
            one = np.ones_like(x)
            rays = RealRays(x, y, z + 20.0, 0 * one, 0 * one, -one, one, one)
            system(state, k).surface_group.trace(rays)
            where = np.stack([rays.x, rays.y, rays.z], axis=-1)
            spots.append(np.stack([where @ rivals.SIDEWAYS[k], where[:, 2]], axis=-1))
        return reading_of(spots, len(points))

    return lambda states: np.array([one(state) for state in states])


def mitsuba_tracer(points: Floats) -> Callable[[Floats], Floats]:
    """A triangle mesh for the mirror, rectangles for the detectors; single precision."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    where = mi.Point2f(*points.T.astype(np.float32))
    detectors = {}
    for k in range(3):
        place = rivals.SENSOR.psds[k].radius * rivals.OUTWARD[k]
        look = mi.ScalarTransform4f().look_at(place.tolist(), [0, 0, 0], [0, 0, 1])
        detectors[f"psd{k}"] = {
            "type": "rectangle",
            "to_world": look @ mi.ScalarTransform4f().scale(40),
        }

    def pyramid(state: Floats) -> Any:
        edges = rivals.edge_directions(rivals.facet_normals(state))
        corners = np.concatenate([[state[:3]], state[:3] + 20 * edges])
        mesh = mi.Mesh("mirror", 4, 3, has_vertex_normals=False)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = mi.Float(corners.astype(np.float32).ravel())
        parameters["faces"] = mi.UInt32([0, 1, 2, 0, 2, 3, 0, 3, 1])
        parameters.update()
        return mesh

    def one(state: Floats) -> list[float]:
        scene = mi.load_dict({"type": "scene", "mirror": pyramid(state), **detectors})
        start = mi.Point3f(
            float(state[6]) + rivals.SIGMA * where.x, float(state[7]) + rivals.SIGMA * where.y, 30.0
        )
        first = scene.ray_intersect_preliminary(mi.Ray3f(start, mi.Vector3f(0, 0, -1)))
        hit = first.compute_surface_interaction(mi.Ray3f(start, mi.Vector3f(0, 0, -1)))
        normal = dr.select(hit.n.z < 0, -hit.n, hit.n)
        leaving = mi.Vector3f(0, 0, -1) + 2 * normal.z * normal
        landed = scene.ray_intersect(mi.Ray3f(hit.p + 1e-3 * normal, leaving))
        spots = np.array(landed.p).T
        facet = np.array(first.prim_index)
        found = []
        for k in range(3):
            on = spots[(facet == k) & (np.abs(spots @ rivals.OUTWARD[k]) > 200)].astype(float)
            found.append(np.stack([on @ rivals.SIDEWAYS[k], on[:, 2]], axis=-1))
        return reading_of(found, len(points))

    return lambda states: np.array([one(state) for state in states])
