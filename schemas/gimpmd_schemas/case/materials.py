"""Materials of the continuum: their form, their checks, and what follows from their numbers.

A new material is a struct here that stands in ``Material`` (and in ``Isotropic`` if it has Lame's
moduli), and a law in ``gimpmd_gimp.laws``.
"""

from __future__ import annotations

from typing import Literal, TypeGuard

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.base import Pair, Strict
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.mechanics import elasticity, hyperelastic
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.hyperelastic import degree_of
from gimpmd_schemas.mechanics.units import UNITS

KEY = "continuum.material"
"""Where the material stands in the case file."""

SOFTEST = 1e-9
"""Least ratio of a stiffness matrix's smallest and largest eigenvalue."""

DEGREE, DEGREES = 4, (3, 6)
"""Degree of the energy of a crystal in three dimensions, if none is given, and its bounds."""

STRAIN_LIMITS = (0.005, 0.1)
"""Bounds of the strain up to which it is fitted."""


class Elastic(Strict, frozen=True, tag_field="from", tag="moduli"):
    """Isotropic elasticity with moduli given in the case file.

    Attributes
    ----------
    density : mass per area; in three dimensions mass per volume.
    lame, shear : Lame's lambda and the shear modulus mu (pressure units), so that
        ``C11 = lambda + 2 mu`` in plane strain and in three dimensions.
    model : ``linear``, or compressible ``neo-hookean`` for large strains.
    plane : ``strain``, or ``stress`` for a thin sheet (linear, in two dimensions).
    """

    density: float
    lame: float
    shear: float
    model: Literal["linear", "neo-hookean"] = "linear"
    plane: Literal["strain", "stress"] = "strain"

    def check(self, dim: int, rules: Rules) -> None:
        """Check density, moduli and the plane."""
        sheet = self.plane == "stress"
        _check_density(self, rules)
        _check_moduli(self, dim == 2 and not sheet, rules)
        rules.require(
            not sheet or (dim == 2 and self.model == "linear"),
            f"{KEY}.plane",
            self.plane,
            "is available in two dimensions with linear elasticity only",
            "leave plane out",
        )


class Anisotropic(Strict, frozen=True, tag_field="from", tag="stiffness"):
    """Linear elasticity of any symmetry.

    Attributes
    ----------
    density : mass per area; in three dimensions mass per volume.
    stiffness : symmetric positive definite matrix (pressure units) between stress and strain in
        the order xx, yy, xy or xx, yy, zz, yz, xz, xy, with engineering shear.
    thermal_stress : stress at rest for each unit of temperature (pressure over temperature units),
        in that order; negative where a warm body expands.
    """

    density: float
    stiffness: tuple[tuple[float, ...], ...]
    thermal_stress: tuple[float, ...] | None = None

    def check(self, dim: int, rules: Rules) -> None:
        """Check that the stiffness is a symmetric, positive definite matrix of the right size."""
        _check_density(self, rules)
        key, n = f"{KEY}.stiffness", len(VOIGT[dim])
        _check_thermal_stress(self, dim, rules)
        rows = [len(row) for row in self.stiffness]
        if not rules.require(
            rows == [n] * n,
            key,
            rows,
            f"must be a matrix of {n} rows of {n} numbers in {dim} dimensions",
            "order the rows xx, yy, xy" if dim == 2 else "order the rows xx, yy, zz, yz, xz, xy",
        ):
            return
        matrix = np.array(self.stiffness)
        size = float(np.abs(matrix).max())
        if not rules.require(
            float(np.abs(matrix - matrix.T).max()) <= SOFTEST * size,
            key,
            self.stiffness,
            "must be symmetric",
            "let C[i][j] equal C[j][i]",
        ):
            return
        _check_positive(matrix, key, self.stiffness, rules)


class Hyperelastic(Strict, frozen=True, tag_field="from", tag="hyperelastic"):
    """Finite elasticity of a crystal.

    Attributes
    ----------
    density : mass per area; in three dimensions mass per volume.
    coefficients : of the strain energy (pressure units), a polynomial in the Green-Lagrange
        strain, in the order that ``hyperelastic.exponents`` gives.
    strain_limit : norm of the strain up to which the polynomial holds.
    lame, shear : moduli of a crystal that is isotropic at small strains (pressure units). None: the
        quadratic coefficients give the stiffness, of any symmetry.
    thermal_stress : as in `Anisotropic`.
    """

    density: float
    coefficients: tuple[float, ...]
    strain_limit: float
    lame: float | None = None
    shear: float | None = None
    thermal_stress: tuple[float, ...] | None = None

    def check(self, dim: int, rules: Rules) -> None:
        """Check density, moduli and the coefficients of the energy."""
        _check_density(self, rules)
        _check_thermal_stress(self, dim, rules)
        rules.require(
            self.strain_limit > 0, f"{KEY}.strain_limit", self.strain_limit, "must be positive"
        )
        count, strains, key = len(self.coefficients), len(VOIGT[dim]), f"{KEY}.coefficients"
        whole = rules.require(
            degree_of(strains, count) is not None,
            key,
            count,
            f"numbers are not those of a polynomial in {strains} strains",
            "let LAMMPS find them: from: md with model: cauchy-born",
        )
        if is_isotropic(self):
            _check_moduli(self, dim == 2, rules)
        elif (
            rules.require(
                self.lame is None and self.shear is None,
                f"{KEY}.{'shear' if self.shear is None else 'lame'}",
                None,
                "is missing: lame and shear belong together",
                "give both, or neither",
            )
            and whole
        ):
            _check_positive(stiffness(self, dim), key, self.coefficients, rules)


class PairLattice(Strict, frozen=True, tag_field="from", tag="lattice"):
    """Finite elasticity of a plane crystal with one atom per primitive cell and a pair potential.

    Attributes
    ----------
    density : mass per area.
    lame, shear : moduli at small strains (pressure units).
    area : area of the primitive cell (length^2).
    bonds : vectors to the neighbours within the cutoff, one of each pair of opposite ones.
    energy : for each bond the coefficients of its energy, as in `Crystal` (energy units).
    stretch_limit : ``|s - 1|`` up to which the polynomials hold.
    """

    density: float
    lame: float
    shear: float
    area: float
    bonds: tuple[Pair, ...]
    energy: tuple[tuple[float, ...], ...]
    stretch_limit: float

    def check(self, dim: int, rules: Rules) -> None:
        """Check density, moduli, bonds and their energies."""
        _check_density(self, rules)
        _check_moduli(self, dim == 2, rules)
        way_out = "let LAMMPS find them: from: md with model: cauchy-born"
        rules.require(
            dim == 2,
            f"{KEY}.from",
            "lattice",
            "is available in two dimensions only",
            "give the moduli",
        )
        _check_lattice(self, ("area", "stretch_limit"), way_out, rules)
        rules.require(
            len(self.energy) == len(self.bonds) and all(map(len, self.energy)),
            f"{KEY}.energy",
            len(self.energy),
            f"must have a list of coefficients for each of {len(self.bonds)} bonds",
            way_out,
        )


class EmbeddedLattice(Strict, frozen=True, tag_field="from", tag="embedded"):
    """Finite elasticity of a crystal of embedded atoms with one atom per primitive cell, in space.

    Tables are little-endian floats of 8 bytes, at evenly spaced points of which the first is 0;
    they are interpolated as LAMMPS does it (`gimpmd_schemas.mechanics.splines`).

    Attributes
    ----------
    density : mass per volume.
    stiffness : at small strains, as in `Anisotropic`.
    volume : of the primitive cell (length^3).
    bonds : vectors to the neighbours, one of each pair of opposite ones (length).
    cutoff : distance at which the tables end (length).
    distance_step, density_step : distances of their points.
    pair, cloud : distance times energy of a pair, and the density that an atom makes, over the
        distance.
    embedding : energy of an atom over the density at it.
    thermal_stress : as in `Anisotropic`.
    """

    density: float
    stiffness: tuple[tuple[float, ...], ...]
    volume: float
    bonds: tuple[tuple[float, float, float], ...]
    cutoff: float
    distance_step: float
    density_step: float
    pair: bytes
    cloud: bytes
    embedding: bytes
    thermal_stress: tuple[float, ...] | None = None

    def check(self, dim: int, rules: Rules) -> None:
        """Check the numbers, and the length of the tables."""
        way_out = "let LAMMPS find it: from: md with model: lattice-sum"
        rules.require(dim == 3, f"{KEY}.from", "embedded", "is for three dimensions", way_out)
        Anisotropic(
            density=self.density, stiffness=self.stiffness, thermal_stress=self.thermal_stress
        ).check(3, rules)
        _check_lattice(self, ("volume", "cutoff", "distance_step", "density_step"), way_out, rules)
        for name in ("pair", "cloud", "embedding"):
            size = len(getattr(self, name))
            rules.require(
                size >= 40 and size % 8 == 0,
                f"{KEY}.{name}",
                size,
                "bytes are no table of five or more numbers",
                way_out,
            )


class J2(Strict, frozen=True, tag_field="from", tag="j2"):
    """Isotropic elasticity, and von Mises plasticity with linear isotropic hardening.

    Strains are small. In two dimensions this is plane strain.

    Attributes
    ----------
    density : mass per area; in three dimensions mass per volume.
    lame, shear : Lame's lambda and the shear modulus mu (pressure units).
    yield_stress : stress at which a bar yields in uniaxial tension (pressure units).
    hardening : slope of the yield stress over the equivalent plastic strain (pressure units).
    """

    density: float
    lame: float
    shear: float
    yield_stress: float
    hardening: float = 0.0

    def check(self, dim: int, rules: Rules) -> None:
        """Check density, moduli, yield stress and hardening."""
        _check_density(self, rules)
        _check_moduli(self, False, rules)  # plasticity strains a body across the plane too
        rules.require(
            self.yield_stress > 0,
            f"{KEY}.yield_stress",
            self.yield_stress,
            "must be positive",
            "for a material that does not yield write from: moduli",
        )
        rules.require(
            self.hardening >= 0,
            f"{KEY}.hardening",
            self.hardening,
            "must not be negative: a material that softens has no unique solution",
            "write 0 for ideal plasticity",
        )


class MeasuredByMd(Strict, frozen=True, tag_field="from", tag="md"):
    """Density and moduli measured by LAMMPS on a periodic cell of the same crystal.

    Attributes
    ----------
    cell : LAMMPS script that makes the periodic cell, beside the case file.
    model : ``linear``; ``cauchy-born`` for the crystal's own energy at finite strains; or
        ``lattice-sum`` for this energy exactly, of embedded atoms in three dimensions.
    degree : of the polynomial of that energy in three dimensions; None for `DEGREE`.
    strain_limit : norm of the strain up to which it is fitted there; None: LAMMPS finds it.
    """

    cell: str
    model: Literal["linear", "cauchy-born", "lattice-sum"] = "linear"
    degree: int | None = None
    strain_limit: float | None = None

    def check(self, dim: int, rules: Rules) -> None:
        """Check that LAMMPS can measure the material."""
        rules.require(
            dim == 3 or self.model != "lattice-sum",
            f"{KEY}.model",
            self.model,
            "is for three dimensions",
            "write model: cauchy-born, which finds lattice sums in two dimensions by itself",
        )
        for name, lowest, highest in (("degree", *DEGREES), ("strain_limit", *STRAIN_LIMITS)):
            key, value = f"{KEY}.{name}", getattr(self, name)
            if value is None:
                continue
            rules.require(
                lowest <= value <= highest,
                key,
                value,
                f"must lie between {lowest:g} and {highest:g}",
                "leave it out, for a choice that suits most crystals",
            )
            rules.require(
                dim == 3 and self.model == "cauchy-born",
                key,
                value,
                "is that of model: cauchy-born in three dimensions",
                "leave it out",
            )


Isotropic = Elastic | Hyperelastic | PairLattice | J2
"""A material that may have Lame's moduli; see `is_isotropic`."""

Material = Elastic | Anisotropic | Hyperelastic | PairLattice | EmbeddedLattice | J2
"""A material whose numbers are known."""


# --- checks --------------------------------------------------------------------------------------


def check_material(
    material: Material | MeasuredByMd, temperature: float | None, dim: int, rules: Rules
) -> None:
    """Check that a material is stable, fit for the number of dimensions and the temperature."""
    if temperature is not None:
        _check_temperature(material, temperature, dim, rules)
    material.check(dim, rules)


def _check_temperature(
    material: Material | MeasuredByMd, temperature: float, dim: int, rules: Rules
) -> None:
    key = "continuum.temperature"
    rules.require(temperature >= 0, key, temperature, "must not be negative")
    if isinstance(material, MeasuredByMd):
        # whether a crystal in the plane is bound in pairs shows once it has been measured
        known = dim == 3 or material.model == "cauchy-born"
    elif isinstance(material, Anisotropic | Hyperelastic | EmbeddedLattice):
        known = material.thermal_stress is not None
    else:
        known = isinstance(material, PairLattice)
    rules.require(
        known,
        key,
        temperature,
        "needs the thermal stress of the material, which is not known",
        "let LAMMPS measure it with continuum.material: {from: md, cell: ...}, in two dimensions "
        "with model: cauchy-born and pair bonds; or give thermal_stress with from: stiffness or "
        "from: hyperelastic; or leave the key out",
    )


def _check_density(material: Material, rules: Rules) -> None:
    rules.require(material.density > 0, f"{KEY}.density", material.density, "must be positive")


def _check_lattice(
    material: PairLattice | EmbeddedLattice, sizes: tuple[str, ...], way_out: str, rules: Rules
) -> None:
    """Check that some numbers are positive, and that bonds have a length."""
    for name in sizes:
        value = getattr(material, name)
        rules.require(value > 0, f"{KEY}.{name}", value, "must be positive")
    rules.require(
        bool(material.bonds) and all(any(bond) for bond in material.bonds),
        f"{KEY}.bonds",
        material.bonds,
        "must contain vectors of nonzero length",
        way_out,
    )


def _check_thermal_stress(material: Anisotropic | Hyperelastic, dim: int, rules: Rules) -> None:
    n = len(VOIGT[dim])
    rules.require(
        material.thermal_stress is None or len(material.thermal_stress) == n,
        f"{KEY}.thermal_stress",
        material.thermal_stress,
        f"must have {n} numbers in {dim} dimensions",
        "give them in the order of the rows of the stiffness",
    )


def _check_positive(matrix: Floats, key: str, value: object, rules: Rules) -> None:
    """Check that a symmetric stiffness is positive definite."""
    size = float(np.abs(matrix).max())
    softest = float(np.linalg.eigvalsh(matrix / size)[0]) if size > 0.0 else 0.0
    rules.require(
        softest > SOFTEST,
        key,
        value,
        f"must be positive definite; its smallest eigenvalue is {softest * size:.3g}",
        "check signs and order of the entries",
    )


def _check_moduli(material: Isotropic, in_plane: bool, rules: Rules) -> None:
    """Check that the shear and the bulk modulus are positive.

    The bulk modulus is ``lambda + 2 mu / d``; d is 2 where all strains lie ``in_plane``, else 3.
    """
    lame, shear = _moduli(material)
    rules.require(shear > 0, f"{KEY}.shear", shear, "must be positive")
    share = 1.0 if in_plane else 2.0 / 3.0
    rules.require(
        lame + share * shear > 0.0,
        f"{KEY}.lame",
        lame,
        f"must exceed {-share * shear:g}, minus {'' if in_plane else '2/3 of '}the shear modulus, "
        "for a stiff material",
    )


# --- numbers that follow -------------------------------------------------------------------------


def is_isotropic(material: Material) -> TypeGuard[Isotropic]:
    """Whether a material has Lame's moduli; else it has a stiffness."""
    if isinstance(material, Anisotropic | EmbeddedLattice):
        return False
    return material.lame is not None and material.shear is not None


def stiffness(material: Material, dim: int) -> Floats:
    """Stiffness at small strains (pressure units), shape ``(3, 3)`` or ``(6, 6)``, Voigt order."""
    if isinstance(material, Anisotropic | EmbeddedLattice):
        return np.array(material.stiffness)
    if isinstance(material, Hyperelastic) and not is_isotropic(material):
        return hyperelastic.stiffness(len(VOIGT[dim]), material.coefficients)
    return elasticity.isotropic(_lame(material), _moduli(material)[1], dim)


def wave_speed(material: Material, units: str, dim: int, kind: elasticity.WaveKind) -> float:
    """Speed of plane waves, or ``sqrt(E / rho)`` of paper Eq. 17 (length / time).

    For an anisotropic material these are the fastest (P) and slowest (S) wave along the axes, and
    the bar wave along x.
    """
    if is_isotropic(material):
        modulus = elasticity.isotropic_modulus(_lame(material), _moduli(material)[1], dim, kind)
    else:
        modulus = elasticity.anisotropic_modulus(stiffness(material, dim), kind)
    return _speed(material, units, modulus)


def axial_wave_speed(material: Material, units: str, dim: int, axis: int, component: int) -> float:
    """Speed of a plane wave along an axis that moves the body along a component."""
    tensor = elasticity.christoffel(stiffness(material, dim), axis)
    return _speed(material, units, float(tensor[component, component]))


def slowest_speed(material: Material, units: str, dim: int, axis: int) -> float:
    """Speed of the slowest plane wave along an axis."""
    tensor = elasticity.christoffel(stiffness(material, dim), axis)
    return _speed(material, units, float(np.linalg.eigvalsh(tensor)[0]))


def thermal_energy(temperature: float | None, units: str) -> float | None:
    """Boltzmann's constant times a temperature, in mechanical units; None for None."""
    if temperature is None:
        return None
    style = UNITS[units]
    return style.energy_to_mechanical(style.boltz * temperature)


def _speed(material: Material, units: str, modulus: float) -> float:
    return float((UNITS[units].stress_to_mechanical(modulus) / material.density) ** 0.5)


def _moduli(material: Isotropic) -> tuple[float, float]:
    """Lame's lambda and the shear modulus of a material that has them."""
    if material.lame is None or material.shear is None:
        raise ValueError("the material has no Lame's moduli, but a stiffness")
    return material.lame, material.shear


def _lame(material: Isotropic) -> float:
    """Lame's lambda in the plane."""
    lame, shear = _moduli(material)
    if isinstance(material, Elastic) and material.plane == "stress":
        return elasticity.plane_stress(lame, shear)
    return lame
