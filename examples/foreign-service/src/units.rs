//! Units: pressures and energies of the unit style in mass, length and time of the style.

use crate::failure::Failure;

pub struct Units {
    /// One unit of pressure in mass / time^2 (in two dimensions).
    pub pressure: f64,
    /// One unit of energy in mass length^2 / time^2.
    pub energy: f64,
}

impl Units {
    pub fn of(style: &str) -> Result<Units, Failure> {
        // mass velocity^2 in energy, and energy / length^d in pressure, as LAMMPS has them
        let (mvv2e, nktv2p) = match style {
            "lj" | "si" => (1.0, 1.0),
            "metal" => (1.0364269e-4, 1.6021765e6),
            "real" => (48.88821291f64.powi(2), 68568.415),
            _ => return Err(Failure::Input(format!("units: unknown style {style}"))),
        };
        Ok(Units { pressure: 1.0 / (nktv2p * mvv2e), energy: 1.0 / mvv2e })
    }
}
