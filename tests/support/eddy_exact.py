r"""Closed forms of coils beside conductors, at a complex frequency s: real s for a decay, 2 pi j f for a sine.

All are inductances in H that a body adds, per ampere in the coil, with kappa = sqrt(s mu sigma) inside of the body.
Sections are (r1, r2, z1, z2) in m, with turns spread evenly; bodies are (conductivity in S/m, mu_r).

References
----------
C. V. Dodd and W. E. Deeds, J. Appl. Phys. 39 (1968) 2829: coils above a plate and around a rod.
W. R. Smythe, Static and Dynamic Electricity, 3rd ed. (McGraw-Hill, 1968), chapter 10: sphere and round core.
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974): sheets.
"""

from itertools import pairwise

import numpy as np
from scipy import special

from femfit.core.numerics import MU_0


def _gauss(low, high, count):
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (low + high) + 0.5 * (high - low) * nodes, 0.5 * (high - low) * weights


def _wave_numbers(longest, smallest):
    """Nodes and weights for an integral over k from 0 to where exp(-k smallest) has faded out."""
    edges = np.concatenate([[0.0], np.geomspace(1e-4 / longest, 1.0 / longest, 12)])
    edges = np.concatenate([edges, np.arange(2.0 / longest, 40.0 / smallest + 2.0 / longest, 1.0 / longest)])
    parts = [_gauss(low, high, 12) for low, high in pairwise(edges)]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def above_plate(s, body, section, turns, thickness=np.inf):
    """A coil at heights z1 to z2 above a plate without an edge.

    pi mu_0 N^2 / S^2 int R(k) [int r J_1(k r) dr]^2 [int exp(-k z) dz]^2 dk, R the plate's reflection.
    """
    sigma, mu_r = body
    r1, r2, z1, z2 = section
    k, weights = _wave_numbers(r2, 2.0 * z1)
    inside = np.sqrt(k**2 + s * MU_0 * mu_r * sigma)
    slope, back = inside / mu_r, np.exp(-2.0 * inside * thickness)
    reflected = (k**2 - slope**2) * (1.0 - back) / ((k + slope) ** 2 - (k - slope) ** 2 * back)
    r, over_r = _gauss(r1, r2, 60)
    radial = special.j1(np.outer(k, r)) * r @ over_r
    axial = (np.exp(-k * z1) - np.exp(-k * z2)) / k
    density = turns / ((r2 - r1) * (z2 - z1))
    return np.pi * MU_0 * density**2 * np.sum(weights * reflected * (radial * axial) ** 2)


def around_rod(s, body, radius, section, turns):
    """A coil around a rod without ends.

    2 mu_0 N^2 / S^2 int C(k) [int r K_1(k r) dr]^2 [2 sin(k l / 2) / k]^2 dk; C joins A and H_z at the rod's surface.
    """
    sigma, mu_r = body
    r1, r2, z1, z2 = section
    k, weights = _wave_numbers(z2 - z1 + r2, 2.0 * (r1 - radius))
    inside, x = np.sqrt(k**2 + s * MU_0 * mu_r * sigma), k * radius
    slope = inside / mu_r * special.ive(0, inside * radius) / special.ive(1, inside * radius)
    # I_n = ive exp(x), K_n = kve exp(-x): the exponentials go with K_1 of the coil
    joined = (k * special.ive(0, x) - slope * special.ive(1, x)) / (k * special.kve(0, x) + slope * special.kve(1, x))
    r, over_r = _gauss(r1, r2, 60)
    shifted = np.exp(-np.outer(k, r - radius))
    radial = special.kve(1, np.outer(k, r)) * shifted * r @ over_r
    axial = 2.0 * np.sin(0.5 * k * (z2 - z1)) / k
    density = turns / ((r2 - r1) * (z2 - z1))
    return 2.0 * MU_0 * density**2 * np.sum(weights * joined * (radial * axial) ** 2)


def around_sphere(s, body, radius, section, turns, *, terms=80):
    """A coil around a sphere at the origin, no point of its section within the sphere.

    pi mu_0 sum D_n a^(2n+1) T_n^2 / (n (n + 1)), T_n = N / S int sin(theta) b^-n P_n^1(cos theta) dS.
    """
    r1, r2, z1, z2 = section
    (r, over_r), (z, over_z) = _gauss(r1, r2, 24), _gauss(z1, z2, 24)
    away = np.hypot(r[:, None], z[None, :])
    cosine, sine = z[None, :] / away, r[:, None] / away
    density = turns / ((r2 - r1) * (z2 - z1))
    total, n = 0.0, np.arange(1, terms + 1)
    for order, joined in zip(n, sphere_reflection(s, body, radius, n), strict=True):
        legendre = special.lpmv(1, order, cosine)
        moment = density * over_r @ (sine * (radius / away) ** order * legendre) @ over_z
        total = total + joined * radius * moment**2 / (order * (order + 1))
    return np.pi * MU_0 * total


def sphere_reflection(s, body, radius, n):
    """D_n: the moment that a field of order n induces, 2 (mu_r - 1) / (mu_r + 2) for n = 1 at rest."""
    sigma, mu_r = body
    x = np.sqrt(s * MU_0 * mu_r * sigma) * radius
    # x i_n'(x) / i_n(x) + 1 = x I_(n-1/2)(x) / I_(n+1/2)(x) - n
    slope = (x * special.ive(n - 0.5, x) / special.ive(n + 0.5, x) - n) / mu_r
    return (n + 1 - slope) / (n + slope)


def core_ratio(s, body, radius):
    """Flux through a round core over that at rest, in the same even field at its surface: 2 I_1(x) / (x I_0(x))."""
    sigma, mu_r = body
    x = np.sqrt(s * MU_0 * mu_r * sigma) * radius
    return 2.0 * special.ive(1, x) / (x * special.ive(0, x))


def sheet_ratio(s, body, thickness):
    """Mean flux density in a sheet over that at its surface: tanh(x / 2) / (x / 2), x = kappa b."""
    sigma, mu_r = body
    x = 0.5 * np.sqrt(s * MU_0 * mu_r * sigma) * thickness
    return np.tanh(x) / x
