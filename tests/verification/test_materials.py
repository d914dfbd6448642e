"""Energy, stress and tangent of every material: finite differences and closed forms."""

import numpy as np
import pytest
from solving import AXIS, MATERIALS

from fingerfit.fem.assembly import Body
from fingerfit.material.elastic import Elastic
from fingerfit.material.holzapfel import Holzapfel
from fingerfit.material.marlow import Marlow
from fingerfit.material.neo_hooke import NeoHooke
from fingerfit.material.ogden import Ogden
from fingerfit.material.prony import Prony
from fingerfit.material.spread import spread, structure_of
from fingerfit.material.yeoh import Yeoh

STRETCHES = {
    "distinct": [0.8, 1.1, 1.3],
    "double": [0.9, 0.9, 1.25],
    "triple": [1.05, 1.05, 1.05],
    "none": [1.0, 1.0, 1.0],
}


@pytest.mark.parametrize("stretches", STRETCHES)
@pytest.mark.parametrize("name", MATERIALS)
def test_derivatives_by_the_stretches(name, stretches):
    material, stretch, h = MATERIALS[name], np.array(STRETCHES[stretches]), 1e-6
    first, second = material.derivatives(stretch)
    for axis in range(3):
        more, less = stretch * np.exp(np.eye(3)[axis] * h), stretch * np.exp(-np.eye(3)[axis] * h)
        assert first[axis] == pytest.approx((material.energy(more) - material.energy(less)) / (2 * h), abs=3e-9)
        slope = (material.derivatives(more)[0] - material.derivatives(less)[0]) / (2 * h)
        assert second[:, axis] == pytest.approx(slope, abs=5e-8)


def single(material, element="C3D8"):
    """One element, a unit cube; the material at its points."""
    corners = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    body = Body(element, corners, np.arange(8)[None], spread([material], [8]), np.ones(1))
    return body, corners


def stress(material, gradient):
    """First Piola-Kirchhoff stress of a homogeneous deformation, from the nodal forces of a cube."""
    body, corners = single(material)
    force = body.forces(((gradient - np.eye(3)) @ corners.T).T.ravel())[0].reshape(8, 3)
    return force.T @ corners


@pytest.mark.parametrize("stretches", STRETCHES)
@pytest.mark.parametrize("relaxing", [False, True], ids=["elastic", "relaxing"])
@pytest.mark.parametrize("name", MATERIALS)
def test_an_element_is_consistent_at_close_stretches(name, stretches, relaxing, rng):
    """Forces are the derivative of the energy and stiffness that of the forces, rotated, with history and fibres."""
    material, h = MATERIALS[name], 1e-6
    if relaxing:
        material = type(material)(**{**vars(material), "prony": Prony((0.3, 0.2), (1.0, 10.0), k=(0.1, 0.4))})
    body, corners = single(material)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    if relaxing:
        body.begin(0.5)
        body.commit(0.05 * rng.normal(size=24), 0.5)
        body.begin(0.7)
    gradient = turn @ np.diag(STRETCHES[stretches]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    gradient *= np.sign(np.linalg.det(gradient))
    u = ((gradient - np.eye(3)) @ corners.T).T.ravel()
    force, stiffness = body.forces(u)
    order = body.dofs[0]
    for dof in range(0, 24, 3):
        step = np.eye(24)[dof] * h
        slope = (body.energy(u + step) - body.energy(u - step)) / (2 * h)
        # undistorted fibres are at the kink where they begin to pull: the tangent there is one-sided, see below
        kink = name == "holzapfel" and stretches in ("triple", "none")
        assert force[0][list(order).index(dof)] == pytest.approx(slope, abs=1e-7 if kink else 1e-9)
        if kink:
            continue
        change = (body.forces(u + step)[0] - body.forces(u - step)[0])[0] / (2 * h)
        assert stiffness[0][:, list(order).index(dof)] == pytest.approx(change, abs=1e-7)


@pytest.mark.parametrize("stretches", ["triple", "none"])
@pytest.mark.parametrize("axis", [AXIS, (1.0, 0.0, 0.0), (0.0, 0.8, -0.6)])
def test_the_tangent_where_fibres_begin_to_pull_is_one_of_two(axis, stretches):
    """Unstretched fibres have one tangent towards longer ones and one, the matrix's, towards shorter ones.

    The element, which has one point, takes one of them as a whole: which one is a matter of the last digit.
    """
    corners, h = np.vstack([np.zeros(3), np.eye(3)]), 1e-7
    made = [
        Body(
            "C3D4", corners, np.arange(4)[None], spread([Holzapfel(0.02, 0.8, k1, 0.9, 0.1, (axis,))], [1]), np.ones(1)
        )
        for k1 in (0.05, 0.0)
    ]
    u = ((np.array(STRETCHES[stretches]) - 1) * corners).ravel()
    (force, found), (_, matrix) = (body.forces(u) for body in made)
    found, matrix = found[0], matrix[0]
    pulling = np.zeros((12, 12))
    for dof, step in enumerate(np.eye(12) * h):
        sides = np.stack([(made[0].forces(u + way * step)[0] - force)[0] / (way * h) for way in (1, -1)], axis=1)
        # one of both is the matrix's, also where the fibre does not care
        away = np.abs(sides - matrix[:, [dof]]).max(axis=0)
        assert away.min() < 1e-7
        pulling[:, dof] = sides[:, away.argmax()]
    assert np.abs(pulling - matrix).max() > 1e-3
    assert pulling == pytest.approx(pulling.T, abs=2e-7)
    assert min(np.abs(found - matrix).max(), np.abs(found - pulling).max()) < 1e-7


def uniaxial(stretch):
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])


def biaxial(stretch):
    return np.diag([stretch, stretch, stretch**-2])


def planar(stretch):
    return np.diag([stretch, 1.0, 1 / stretch])


def difference(first_piola, gradient, axis=0):
    """Cauchy stress along x (or another axis) less that along z: free of the pressure."""
    cauchy = first_piola @ gradient.T / np.linalg.det(gradient)
    return cauchy[axis, axis] - cauchy[2, 2]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("deformation", [uniaxial, biaxial, planar])
@pytest.mark.parametrize("stretch", [0.7, 1.6])
def test_closed_forms_of_isochoric_tension(deformation, stretch, axis):
    """Cauchy stress differences of incompressible solids (Holzapfel, Nonlinear Solid Mechanics, section 6.5).

    Uniaxial, biaxial and planar: Treloar's three tests.
    """
    gradient = deformation(stretch)
    a, c = gradient[axis, axis], gradient[2, 2]
    i1 = (gradient**2).sum()
    expected = {
        "neo_hooke": 2 * 0.02 * (a**2 - c**2),
        "mooney_rivlin": 2 * 0.02 * (a**2 - c**2) - 2 * 0.008 * (a**-2 - c**-2),
        "yeoh": 2 * (a**2 - c**2) * (0.02 + 2 * 0.004 * (i1 - 3) + 3 * 0.001 * (i1 - 3) ** 2),
        "reduced6": 2
        * (a**2 - c**2)
        * sum(n * k * (i1 - 3) ** (n - 1) for n, k in enumerate(MATERIALS["reduced6"].c, 1)),
        "ogden3": sum(
            2 * mu / alpha * (a**alpha - c**alpha)
            for mu, alpha in zip(MATERIALS["ogden3"].mu, MATERIALS["ogden3"].alpha, strict=True)
        ),
        "hencky": 2 * 0.1 / 2.6 * np.log(a / c),
    }
    for name, value in expected.items():
        found = difference(stress(MATERIALS[name], gradient), gradient, axis)
        assert found == pytest.approx(value, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("deformation", [uniaxial, biaxial, planar])
def test_a_uniaxial_test_says_all_of_a_law_of_the_first_invariant(deformation):
    """Marlow's law of a test of Yeoh's law is Yeoh's law; of higher powers it is, as points come nearer to each other."""
    left = {}
    for name, ratio in (("yeoh", 1.4), ("reduced6", 1.4), ("reduced6", 1.2)):
        law = MATERIALS[name]
        stretch = 1 + 0.02 * ratio ** np.arange(1 + np.ceil(np.log(75) / np.log(ratio)))
        gap = stretch**2 + 2 / stretch - 3
        nominal = 2 * sum(n * c * gap ** (n - 1) for n, c in enumerate(law.c, 1)) * (stretch - stretch**-2)
        marlow = Marlow(tuple(stretch - 1), tuple(nominal), law.d)
        for one, measured in zip(stretch, nominal, strict=True):
            found = difference(stress(marlow, uniaxial(one)), uniaxial(one))
            assert found == pytest.approx(one * measured, rel=1e-9)
        gradients = [deformation(one) for one in (0.8, 0.9, 1.1, 1.3)]
        ratios = [difference(stress(marlow, one), one) / difference(stress(law, one), one) for one in gradients]
        left[name, ratio] = np.abs(np.array(ratios) - 1).max()
    assert left["yeoh", 1.4] < 1e-12
    assert 1e-12 < left["reduced6", 1.2] < min(2e-4, left["reduced6", 1.4])


def test_simple_shear():
    """By principal stretches l and 1/l, l - 1/l = gamma: s12 = (t1 - t2) / sqrt(4 + gamma^2)."""
    gamma = 0.8
    longest = gamma / 2 + np.sqrt(1 + gamma**2 / 4)
    gradient = np.eye(3)
    gradient[0, 1] = gamma
    for name, shear in {
        "neo_hooke": 2 * 0.02 * gamma,
        "mooney_rivlin": 2 * (0.02 + 0.008) * gamma,
        "yeoh": 2 * gamma * (0.02 + 2 * 0.004 * gamma**2 + 3 * 0.001 * gamma**4),
        "ogden3": sum(
            2 * mu / alpha * (longest**alpha - longest**-alpha)
            for mu, alpha in zip(MATERIALS["ogden3"].mu, MATERIALS["ogden3"].alpha, strict=True)
        )
        / np.sqrt(4 + gamma**2),
        "hencky": 4 * 0.1 / 2.6 * np.arcsinh(gamma / 2) / np.sqrt(4 + gamma**2),
    }.items():
        cauchy = stress(MATERIALS[name], gradient) @ gradient.T
        assert cauchy[0, 1] == pytest.approx(shear, rel=1e-12)
        # the same for every isotropic solid (Rivlin)
        assert cauchy[0, 0] - cauchy[1, 1] == pytest.approx(gamma * shear, rel=1e-12)
    # St.Venant-Kirchhoff: S12 = 2 mu E12, S22 = (lambda + 2 mu) E22, P12 = S12 + gamma S22
    lame, mu = 0.1 * 0.3 / (1.3 * 0.4), 0.1 / 2.6
    expected = mu * gamma + gamma * (lame + 2 * mu) * gamma**2 / 2
    assert stress(Elastic(0.1, 0.3), gradient)[0, 1] != pytest.approx(expected, rel=1e-3)  # averaged: Hencky
    assert stress_of_full(Elastic(0.1, 0.3), gradient)[0, 1] == pytest.approx(expected, rel=1e-12)


def stress_of_full(material, gradient):
    corners = single(material)[1]
    body = Body("C3D8", corners, np.arange(8)[None], spread([material], [8]), np.ones(1), averaged=False)
    force = body.forces(((gradient - np.eye(3)) @ corners.T).T.ravel())[0].reshape(8, 3)
    return force.T @ corners


@pytest.mark.parametrize("kappa", [0.0, 0.2, 1 / 3])
def test_fibres_in_closed_form(kappa):
    """Tension along fibres: sigma1 - sigma3 = 2 C10 (a2 - c2) + 2 k1 E exp(k2 E2) (m1 a2 - m3 c2)."""
    material = Holzapfel(0.02, 0.8, 0.05, 0.9, kappa, ((1.0, 0.0, 0.0),))
    gradient = uniaxial(1.3)
    a2, c2 = gradient[0, 0] ** 2, gradient[2, 2] ** 2
    along, across = 1 - 2 * kappa, kappa
    strain = along * a2 + 2 * across * c2 - 1
    fibre = 2 * 0.05 * strain * np.exp(0.9 * strain**2) * (along * a2 - across * c2)
    expected = 2 * 0.02 * (a2 - c2) + fibre
    assert difference(stress(material, gradient), gradient) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kappa", [0.0, 0.2, 1 / 3])
def test_two_families_in_biaxial_tension(kappa):
    """Families at 30 degrees on both sides of x: s_xx - s_zz has cos^2 of it, s_yy - s_zz sin^2, s_xy is zero."""
    cos, sin, stretch = 3**0.5 / 2, 0.5, 1.25
    material = Holzapfel(0.02, 0.8, 0.05, 0.9, kappa, ((cos, sin, 0.0), (cos, -sin, 0.0)))
    gradient = biaxial(stretch)
    first = stress(material, gradient)
    a2, c2 = stretch**2, stretch**-4
    strain = kappa * (2 * a2 + c2 - 3) + (1 - 3 * kappa) * (a2 - 1)
    slope = 2 * 0.05 * strain * np.exp(0.9 * strain**2)
    for axis, share in ((0, cos**2), (1, sin**2)):
        fibres = 2 * slope * (kappa * (a2 - c2) + (1 - 3 * kappa) * a2 * share)
        assert difference(first, gradient, axis) == pytest.approx(2 * 0.02 * (a2 - c2) + fibres, rel=1e-12)
    assert (first @ gradient.T)[0, 1] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("kappa", [0.0, 0.2, 1 / 3])
@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_fibres_in_simple_shear(angle, kappa):
    """A fibre at an angle to x becomes (cos + gamma sin, sin); at 2.0 it gets shorter and does not pull if aligned."""
    cos, sin, gamma = np.cos(angle), np.sin(angle), 0.5
    material = Holzapfel(0.02, 0.8, 0.05, 0.9, kappa, ((cos, sin, 0.0),))
    gradient = np.eye(3)
    gradient[0, 1] = gamma
    cauchy = stress(material, gradient) @ gradient.T
    along = np.array([cos + gamma * sin, sin])
    strain = kappa * gamma**2 + (1 - 3 * kappa) * (along @ along - 1)
    assert (along @ along < 1) == (angle == 2.0)
    slope = 2 * 0.05 * max(strain, 0.0) * np.exp(0.9 * strain**2)
    assert cauchy[0, 1] == pytest.approx(
        2 * 0.02 * gamma + slope * (kappa * gamma + (1 - 3 * kappa) * along[0] * along[1]), rel=1e-12
    )
    normal = kappa * gamma**2 + (1 - 3 * kappa) * (along[0] ** 2 - along[1] ** 2)
    assert cauchy[0, 0] - cauchy[1, 1] == pytest.approx(2 * 0.02 * gamma**2 + slope * normal, rel=1e-12)


def test_fibres_do_not_push():
    material = Holzapfel(0.02, 0.8, 0.05, 0.9, 0.0, ((1.0, 0.0, 0.0),))
    matrix = Holzapfel(0.02, 0.8, 0.0, 0.9, 0.0, ((1.0, 0.0, 0.0),))
    gradient = uniaxial(0.8)
    assert stress(material, gradient) == pytest.approx(stress(matrix, gradient), abs=1e-15)
    assert stress(material, uniaxial(1.2))[0, 0] > 1.2 * stress(matrix, uniaxial(1.2))[0, 0]


def test_relaxation_follows_the_closed_form():
    """After a sudden stretch, sigma1 - sigma3 falls as G(t) / G0, whatever the increments."""
    prony = Prony((0.3, 0.2), (1.0, 10.0), instantaneous=True)
    body, corners = single(NeoHooke(0.02, (0.8,), prony))
    gradient = uniaxial(1.5)
    u = ((gradient - np.eye(3)) @ corners.T).T.ravel()
    first = difference(stress(NeoHooke(0.02, (0.8,)), gradient), gradient)

    def now():
        return difference(body.forces(u)[0].reshape(8, 3).T @ corners, gradient)

    body.begin(0.0)
    assert now() == pytest.approx(first, rel=1e-12)
    body.commit(u, 0.0)
    time = 0.0
    for dt in (0.1, 0.5, 2.0, 5.0, 30.0):
        body.begin(dt)
        time += dt
        expected = first * (1 - 0.3 * (1 - np.exp(-time)) - 0.2 * (1 - np.exp(-time / 10)))
        assert now() == pytest.approx(expected, rel=1e-12)
        body.commit(u, dt)
    body.begin(0.0, relaxed=True)
    assert now() == pytest.approx(first * 0.5, rel=1e-12)


@pytest.mark.parametrize("element", ["C3D8", "C3D8H"])
def test_the_pressure_relaxes_with_its_own_moduli(element):
    """After a sudden change of volume the pressure falls as K(t) / K0, whatever the increments."""
    body, corners = single(NeoHooke(0.02, (0.8,), Prony((0.3, 0.2), (1.0, 10.0), True, (0.5, 0.1))), element)
    u = 0.02 * corners.ravel()

    def now():
        return body.forces(u)[0].reshape(8, 3).T @ corners

    body.begin(0.0)
    first, time = now(), 0.0
    assert first[0, 0] > 0.05 and first[0, 1] == pytest.approx(0.0, abs=1e-12)
    body.commit(u, 0.0)
    for dt in (0.1, 0.5, 2.0, 5.0, 30.0):
        body.begin(dt)
        time += dt
        expected = first * (1 - 0.5 * (1 - np.exp(-time)) - 0.1 * (1 - np.exp(-time / 10)))
        assert now() == pytest.approx(expected, rel=1e-12, abs=1e-14)
        body.commit(u, dt)
    body.begin(0.0, relaxed=True)
    assert now() == pytest.approx(first * 0.4, rel=1e-12, abs=1e-14)


def test_a_ramp_relaxes_as_the_convolution():
    """Small shear at a constant rate: tau = rate (Ginf t + sum G_i tau_i (1 - exp(-t / tau_i))), long-term constants."""
    body, corners = single(NeoHooke(0.02, (0.8,), Prony((0.5,), (2.0,))))
    rate, dt = 1e-6, 0.25
    for n in range(1, 9):
        gradient = np.eye(3)
        gradient[0, 1] = rate * n * dt
        u = ((gradient - np.eye(3)) @ corners.T).T.ravel()
        body.begin(dt)
        shear = (body.forces(u)[0].reshape(8, 3).T @ corners)[0, 1]
        body.commit(u, dt)
        time = n * dt
        expected = rate * (0.04 * time + 0.04 * 2.0 * (1 - np.exp(-time / 2.0)))
        assert shear == pytest.approx(expected, rel=1e-5)


def test_relaxation_is_the_same_in_a_turned_frame(rng):
    """The history turns with the material: a rigid rotation during relaxation changes nothing but directions."""
    prony = Prony((0.6,), (1.0,))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    body, corners = single(Ogden((0.03,), (3.0,), (0.5,), prony))
    gradient = np.diag([1.3, 0.9, 0.95])

    def force(f):
        return body.forces(((f - np.eye(3)) @ corners.T).T.ravel())[0].reshape(8, 3)

    body.begin(0.1)
    body.commit(((gradient - np.eye(3)) @ corners.T).T.ravel(), 0.1)
    body.begin(0.5)
    assert force(turn @ gradient) == pytest.approx(force(gradient) @ turn.T, abs=1e-14)


def test_spread_keeps_kinds_apart():
    alike = [NeoHooke(0.1, (1.0,)), NeoHooke(0.2, (2.0,))]
    assert structure_of(alike[0]) == structure_of(alike[1])
    assert structure_of(alike[0]) != structure_of(Yeoh((0.1, 0.0, 0.0), (1.0,)))
    assert structure_of(NeoHooke(0.1, (1.0,), Prony((0.1,), (1.0,)))) != structure_of(alike[0])
    stretch = np.array([[0.8, 1.1, 1.2], [0.9, 1.0, 1.1]])
    together = spread(alike, [1, 1]).derivatives(stretch)
    for row, material in enumerate(alike):
        assert together[1][row] == pytest.approx(material.derivatives(stretch[row])[1], rel=1e-13)
