"""J-integrals of made-up fields whose energy release rates are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_deploy.analysis.crack import Crack
from gimpmd_deploy.analysis.j_integral import (
    State,
    Weight,
    face,
    flux,
    j_integral,
    pseudomomentum,
    state_of_points,
    tensors,
)
from gimpmd_deploy.analysis.plane import Plane
from gimpmd_schemas.case.materials import Elastic, Hyperelastic
from gimpmd_schemas.errors import InputError
from tests.deploy.analysis.fields import particles, turned

LAME, SHEAR, DENSITY = 27.8, 27.8, 0.93
STIFFNESS = 4.0 * SHEAR * (LAME + SHEAR) / (LAME + 2.0 * SHEAR)
PLANE = Plane.through((0, 0), (1, 0))
INF = np.inf


def grid(cell, half=50.0):
    """Points in the middle of square cells."""
    x = np.arange(-half + 0.5 * cell, half, cell)
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)


def state(X, H, v, cell):
    """Linear isotropic elasticity in plane strain."""
    strain = 0.5 * (H + H.transpose(0, 2, 1))
    trace = np.einsum("nkk->n", strain)
    P = LAME * trace[:, None, None] * np.eye(2) + 2.0 * SHEAR * strain
    W = 0.5 * np.einsum("nij,nij->n", P, strain)
    n = len(X)
    return State(X, np.full(n, cell**2), v, H, P, W, np.full(n, DENSITY))


def at_rest(x, y, K):
    """Displacement of a crack tip with stress intensities K_I, K_II (Williams 1957)."""
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    kappa = (LAME + 3.0 * SHEAR) / (LAME + SHEAR)
    c, s = np.cos(theta / 2), np.sin(theta / 2)
    size = np.sqrt(r / (2.0 * np.pi)) / (2.0 * SHEAR)
    u = K[0] * c * (kappa - 1.0 + 2.0 * s**2) + K[1] * s * (kappa + 1.0 + 2.0 * c**2)
    w = K[0] * s * (kappa + 1.0 - 2.0 * c**2) - K[1] * c * (kappa - 1.0 - 2.0 * s**2)
    return np.stack([size * u, size * w], axis=-1)


def gradient(displacement, X, step=1e-5):
    """Displacement gradient by central differences that do not cross the crack."""
    parts = []
    for axis in range(2):
        d = step * np.eye(2)[axis]
        parts.append((displacement(*(X + d).T) - displacement(*(X - d).T)) / (2.0 * step))
    return np.stack(parts, axis=-1)


def k_field(cell, K, angle=0.0, tip=(0.3, 0.0)):
    X = grid(cell)
    H = gradient(lambda x, y: at_rest(x, y, K), X - tip)
    R = turned(np.eye(2), angle).T
    return state(turned(X, angle), R @ H @ R.T, np.zeros_like(X), cell)


def weight(low=10.0, width=20.0):
    return Weight(((-low, low), (-low, low)), width)


@pytest.mark.parametrize("K", [(1.0, 0.0), (0.0, 1.0), (2.0, -0.7)])
@pytest.mark.parametrize("box", [(5.0, 30.0), (10.0, 20.0), (25.0, 20.0)])
def test_the_field_of_a_crack_at_rest(K, box):
    exact = (K[0] ** 2 + K[1] ** 2) / STIFFNESS
    assert flux(k_field(1.0, K), PLANE, weight(*box)) == pytest.approx(exact, rel=4e-3)


def test_the_error_falls_with_the_square_of_the_cell():
    errors = [
        abs(flux(k_field(cell, (1.0, 0.0)), PLANE, weight()) * STIFFNESS - 1.0)
        for cell in (2.0, 1.0, 0.5)
    ]
    assert errors[2] < 5e-4
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_the_direction_of_the_crack():
    angle = 0.5 * np.pi
    plane = Plane.through((0, 0), (0, 1))
    assert flux(k_field(1.0, (1.0, 0.3), angle), plane, weight()) == pytest.approx(
        1.09 / STIFFNESS, rel=4e-3
    )


def test_noise_averages_out():
    one = k_field(0.5, (1.0, 0.0))
    size = np.sqrt(1.0 / (2.0 * np.pi * 20.0)) / STIFFNESS  # of the strain at 20 from the tip
    noise = 0.1 * size * np.random.default_rng(2).standard_normal(one.H.shape)
    noisy = state(one.X, one.H + noise, one.v, 0.5)
    assert flux(noisy, PLANE, weight()) == pytest.approx(1.0 / STIFFNESS, rel=0.03)


def test_a_free_face_inside_the_weight():
    """Uniform tension along a free face, and no crack: the face cancels the rest."""
    X, cell = grid(1.0), 1.0
    H = np.zeros((len(X), 2, 2))
    H[:, 1, 1], H[:, 0, 0] = 0.01, -0.01 * LAME / (LAME + 2.0 * SHEAR)
    one = state(X, H, np.zeros_like(X), cell)
    box = Weight(((-INF, 10.0), (-10.0, 10.0)), 20.0)
    inside = flux(one, PLANE, box)
    # the weight falls over half of each width, on average
    assert inside == pytest.approx(one.W[0] * 40.0, rel=2e-3)
    assert inside + face(one, PLANE, box, 0, -50.0, -1.0, 2.0) == pytest.approx(
        0, abs=2e-3 * inside
    )
    assert face(one, PLANE, box, 1, 50.0, 1.0, 2.0) == 0.0


def test_a_wave_that_passes_releases_nothing():
    X, cell, c = grid(0.5), 0.5, np.sqrt((LAME + 2.0 * SHEAR) / DENSITY)

    def passing(t):
        bump = np.exp(-(((X[:, 0] + 20.0 - c * t) / 6.0) ** 2))
        H, v = np.zeros((len(X), 2, 2)), np.zeros_like(X)
        H[:, 0, 0], v[:, 0] = 0.01 * bump, -0.01 * c * bump
        return state(X, H, v, cell)

    dt = 0.02
    for t in (0.0, 1.5, 3.0):
        sums = [pseudomomentum(passing(s), PLANE, weight()) for s in (t - dt, t + dt)]
        of_flux = flux(passing(t), PLANE, weight())
        assert of_flux + (sums[1] - sums[0]) / (2 * dt) == pytest.approx(
            0.0, abs=0.01 * abs(of_flux)
        )


def moving(X, speed):
    """Steady field of a tip that moves: ``u = grad Re z_d^1.5 + curl Im B z_s^1.5`` (Freund 1990).

    ``z = x + i alpha y``; B makes the faces free of shear. Returns H for coordinates from the tip.
    """
    cd, cs = np.sqrt((LAME + 2.0 * SHEAR) / DENSITY), np.sqrt(SHEAR / DENSITY)
    ad, as_ = np.sqrt(1.0 - (speed / cd) ** 2), np.sqrt(1.0 - (speed / cs) ** 2)
    B = 2.0 * ad / (1.0 + as_**2)

    def u(x, y):
        zd, zs = np.sqrt(x + 1j * ad * y), np.sqrt(x + 1j * as_ * y)
        return np.stack([zd.real - B * as_ * zs.real, -ad * zd.imag + B * zs.imag], axis=-1)

    return gradient(u, X), ad, as_


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_tip_that_moves(share):
    """``G = (1 - nu^2) / E v^2 alpha_d / ((1 - nu) c_s^2 D) K^2`` (Freund 1990, Eq. 5.3.10)."""
    cs = np.sqrt(SHEAR / DENSITY)
    speed, cell = share * cs, 0.5
    X = grid(cell)

    def now(tip):
        H = moving(X - (tip, 0.0), speed)[0]
        return state(X, H, -speed * H[:, :, 0], cell)

    ahead = np.array([[4.0, 1e-3]])
    H, ad, as_ = moving(ahead, speed)
    K = state(ahead, H, 0.0 * ahead, 1.0).P[0, 1, 1] * np.sqrt(2.0 * np.pi * 4.0)
    nu = 0.5 * LAME / (LAME + SHEAR)
    D = 4.0 * ad * as_ - (1.0 + as_**2) ** 2
    exact = K**2 / STIFFNESS * share**2 * ad / ((1.0 - nu) * D)

    # between two places of the tip, many points apart, the balance holds for the mean of the flux
    step = 10 * cell
    states = [now(0.1 + s) for s in (-step, 0.0, step)]
    sums = [pseudomomentum(state_, PLANE, weight()) for state_ in states]
    of_flux = np.dot([1, 4, 1], [flux(state_, PLANE, weight()) for state_ in states]) / 6.0
    inertia = (sums[2] - sums[0]) / (2.0 * step / speed)
    assert of_flux + inertia == pytest.approx(exact, rel=0.01)
    if share > 0.4:
        assert abs(inertia) > 0.05 * exact  # the test would see a wrong sign


def test_tensors():
    assert tensors(np.array([[1.0, 2.0, 3.0]])).tolist() == [[[1.0, 3.0], [3.0, 2.0]]]
    full = tensors(np.arange(1.0, 7.0)[None])[0]
    assert full.tolist() == [[1.0, 6.0, 5.0], [6.0, 2.0, 4.0], [5.0, 4.0, 3.0]]


# --- a run --------------------------------------------------------------------------------------

CRACK = Crack.between((-50, 0), (0.3, 0))


def run_of(points, **changes):
    plan = SimpleNamespace(
        dim=2,
        units="lj",
        finest_cell=1.0,
        roles=("continuum",),
        coupling=None,
        continuum=SimpleNamespace(material=Elastic(density=DENSITY, lame=LAME, shear=SHEAR)),
        domain=SimpleNamespace(box=((-50.0, 50.0), (-50.0, 50.0)), periodic=(False, False)),
    )
    vars(plan).update(changes)
    return SimpleNamespace(
        plan=plan, folder="runs/a", atoms_file=None, times=[0.0, 1.0], points=points
    )


def points_of(one, time=0.0):
    """Material points as a run writes them."""
    stress = np.stack([one.P[:, 0, 0], one.P[:, 1, 1], one.P[:, 0, 1]], axis=1)
    fields = {
        "displacement_gradient": one.H.reshape(-1, 4),
        "strain_energy": one.W,
        "mass": one.density * one.volume,
    }
    return particles(one.X, v=one.v, stress=stress, time=time, size=1.0, **fields)


def test_a_run_at_rest():
    run = run_of(lambda t: points_of(k_field(1.0, (1.0 + t, 0.0)), t))
    found = j_integral(run, CRACK, box=((-10, 10), (-10, 10)), width=20.0)
    assert pytest.approx(np.array([1.0, 4.0]) / STIFFNESS, rel=4e-3) == found.J
    assert found.inertia == pytest.approx([0.0, 0.0])
    assert list(found.to_dataframe()) == ["time", "flux", "inertia", "faces", "J"]


def test_finite_stress_is_turned_to_the_reference_state():
    """``P = J sigma F^-T``, and density and volume are those of the reference state."""
    F = np.array([[1.1, 0.2], [0.0, 0.9]])
    one = state(np.zeros((1, 2)), (F - np.eye(2))[None], np.zeros((1, 2)), 2.0)
    points = points_of(one._replace(P=np.array([[[3.0, 1.0], [1.0, 2.0]]])))
    material = Hyperelastic(
        density=DENSITY, lame=LAME, shear=SHEAR, coefficients=(), strain_limit=0.1
    )
    plan = run_of(None, continuum=SimpleNamespace(material=material)).plan
    found = state_of_points(points, plan)
    sigma = np.array([[3.0, 1.0], [1.0, 2.0]])
    assert found.P[0] @ F.T / np.linalg.det(F) == pytest.approx(sigma)
    assert found.volume == pytest.approx([4.0])


def test_output_of_an_older_version():
    with pytest.raises(InputError, match="displacement_gradient"):
        state_of_points(particles(np.zeros((1, 2))), run_of(None).plan)


@pytest.mark.parametrize(
    ("changes", "box", "width", "message"),
    [
        ({"dim": 3}, None, None, "two dimensions"),
        ({}, None, None, "no MD region"),
        ({}, ((-10, 10), (-10, 10)), 45.0, "fallen to zero"),
    ],
)
def test_what_cannot_be_integrated(changes, box, width, message):
    with pytest.raises(InputError, match=message):
        j_integral(run_of(None, **changes), CRACK, box=box, width=width)
