//! Energies of bonds: a law for the continuum, and the energy of the rods.

use crate::plan::Pair;

/// Bonds of a crystal, in mechanical units: the energy of bond k is a polynomial in `z = s - 1`,
/// where s is the square of the length over that at rest.
pub struct Bonds {
    pub vectors: Vec<Pair>,
    coefficients: Vec<Vec<f64>>,
}

impl Bonds {
    /// `unit`: the energy unit of the style in mass length^2 / time^2.
    pub fn new(vectors: &[Pair], energy: &[Vec<f64>], unit: f64) -> Bonds {
        let scaled = |list: &Vec<f64>| list.iter().map(|c| c * unit).collect();
        Bonds { vectors: vectors.to_vec(), coefficients: energy.iter().map(scaled).collect() }
    }

    /// Energy of bond k whose ends are r apart, and the force `d energy / d r`.
    pub fn evaluate(&self, k: usize, r: Pair) -> (f64, Pair) {
        let rest = dot(self.vectors[k], self.vectors[k]);
        let z = dot(r, r) / rest - 1.0;
        let (mut energy, mut slope) = (0.0, 0.0);
        for (power, c) in self.coefficients[k].iter().enumerate().rev() {
            energy = z * (energy + c);
            slope = z * slope + (power + 1) as f64 * c;
        }
        (energy, r.map(|x| 2.0 * slope / rest * x))
    }

    /// Strain energy density and first Piola-Kirchhoff stress of the crystal.
    pub fn stress(&self, F: [Pair; 2], area: f64) -> (f64, [Pair; 2]) {
        let (mut energy, mut P) = (0.0, [[0.0; 2]; 2]);
        for (k, R) in self.vectors.iter().enumerate() {
            let (phi, q) = self.evaluate(k, apply(F, *R));
            energy += phi / area;
            for i in 0..2 {
                for j in 0..2 {
                    P[i][j] += q[i] * R[j] / area;
                }
            }
        }
        (energy, P)
    }

    pub fn longest(&self) -> f64 {
        self.vectors.iter().map(|R| dot(*R, *R).sqrt()).fold(0.0, f64::max)
    }
}

pub fn dot(a: Pair, b: Pair) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub fn apply(F: [Pair; 2], R: Pair) -> Pair {
    F.map(|row| dot(row, R))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forces_are_derivatives_of_the_energy() {
        let bonds = Bonds::new(&[[1.0, 0.5]], &[vec![0.1, 2.0, -3.0, 4.0]], 1.0);
        let (r, step) = ([1.02, 0.47], 1e-6);
        let (_, force) = bonds.evaluate(0, r);
        for axis in 0..2 {
            let (mut up, mut down) = (r, r);
            up[axis] += step;
            down[axis] -= step;
            let slope = (bonds.evaluate(0, up).0 - bonds.evaluate(0, down).0) / (2.0 * step);
            assert!((slope - force[axis]).abs() < 1e-8);
        }
    }
}
