"""The stretch behind an initial stress."""

import numpy as np
import pytest
from seeds import generator

from fingerfit.material.ogden import Ogden
from fingerfit.material.prestretch import prestretch


def stressed(material, stretch):
    """Deviatoric Cauchy stress at a symmetric stretch, shape (3, 3)."""
    values, axes = np.linalg.eigh(stretch)
    return axes @ np.diag(material.deviatoric_derivatives(values)[0]) @ axes.T


@pytest.mark.parametrize("alpha", [(1.4,), (2.0,), (9.0,), (1.4, -2.0)])
def test_it_is_the_stretch_at_which_the_material_has_the_stress(alpha):
    material = Ogden((0.03, 0.01)[: len(alpha)], alpha, (0.5,) * len(alpha))
    rng = generator(len(alpha))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    logarithm = rng.uniform(-0.4, 0.4, 3)
    stretch = axes @ np.diag(np.exp(logarithm - logarithm.mean())) @ axes.T
    # a pressure changes nothing
    found = prestretch(material, stressed(material, stretch) + 0.02 * np.eye(3))
    assert found == pytest.approx(stretch, abs=1e-9)


def test_what_no_stretch_reaches_is_refused():
    with pytest.raises(ValueError, match="which the material does not reach"):
        prestretch(Ogden((0.03,), (0.1,), (0.5,)), np.diag([1e6, -1e6, 0.0]))
