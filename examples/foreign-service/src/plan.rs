//! What this service reads of `plan.yaml`, and what it refuses.

use std::fs;
use std::path::Path;

use serde::de::IgnoredAny;
use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::failure::Failure;

pub type Pair = [f64; 2];

#[derive(Deserialize)]
pub struct Plan {
    /// SHA-256 of the file, in hex.
    #[serde(skip)]
    pub digest: String,
    pub units: String,
    pub domain: Domain,
    pub level_cells: Vec<f64>,
    pub step: f64,
    pub steps: i64,
    pub energies_every: i64,
    pub output_every: i64,
    pub continuum: Continuum,
    pub coupling: Option<Coupling>,
    pub checkpoint: Option<Checkpoint>,
    pub boundary: Boundary,
    pub initial: Initial,
}

#[derive(Deserialize)]
struct Size {
    dim: usize,
}

#[derive(Deserialize)]
pub struct Domain {
    pub r#box: Vec<Pair>,
    pub periodic: Vec<bool>,
}

#[derive(Deserialize)]
pub struct Continuum {
    pub material: Material,
    pub temperature: Option<f64>,
    pub flip: f64,
    pub damping: Vec<IgnoredAny>,
    pub body_force: Option<IgnoredAny>,
    pub cracks: Vec<IgnoredAny>,
    pub ranks: usize,
}

/// Materials that this service has; stiffnesses are pressures of the unit style.
#[derive(Deserialize)]
#[serde(tag = "from", rename_all = "lowercase")]
pub enum Material {
    Moduli { density: f64, lame: f64, shear: f64, model: String, plane: String },
    Stiffness { density: f64, stiffness: [[f64; 3]; 3] },
    Lattice { density: f64, area: f64, bonds: Vec<Pair>, energy: Vec<Vec<f64>>, stretch_limit: f64 },
    Hyperelastic {},
    J2 {},
}

#[derive(Deserialize)]
pub struct Coupling {
    pub scheme: String,
    pub crystal: Option<Crystal>,
    pub interfaces: Vec<Interface>,
    /// It acts in the MD code, which needs more nodes for it.
    pub absorber: Option<IgnoredAny>,
}

/// A lattice whose bonds have energies `sum_k c_k (s - 1)^k`, `s = (length / length at rest)^2`.
#[derive(Deserialize)]
pub struct Crystal {
    pub vectors: [Pair; 2],
    pub origin: Pair,
    pub bonds: Vec<Pair>,
    pub energy: Vec<Vec<f64>>,
}

/// Planes about the free atoms of one MD region, by axis; infinite where there is none.
#[derive(Deserialize)]
pub struct Interface {
    pub planes: Vec<Pair>,
    pub region: Vec<Pair>,
}

#[derive(Deserialize)]
pub struct Checkpoint {
    pub every: i64,
    pub seconds: Option<f64>,
}

#[derive(Deserialize)]
pub struct Boundary {
    pub left: Parts,
    pub right: Parts,
    pub bottom: Parts,
    pub top: Parts,
}

/// A face has one condition, or several parts with one each.
#[derive(Deserialize)]
#[serde(untagged)]
pub enum Parts {
    Whole(Face),
    Several(#[allow(dead_code)] IgnoredAny),
}

#[derive(Clone, Deserialize)]
pub struct Face {
    pub condition: String,
    pub value: Value,
    pub ramp: f64,
    pub history: Vec<Pair>,
    pub extent: Vec<Pair>,
}

/// Components that a face prescribes, or a function of position.
#[derive(Clone, Deserialize)]
#[serde(untagged)]
pub enum Value {
    Components(Vec<Option<f64>>),
    Profile(#[allow(dead_code)] IgnoredAny),
}

#[derive(Deserialize)]
pub struct Initial {
    pub packets: Vec<Packet>,
    pub velocities: Vec<Velocity>,
    pub stretch: Option<Stretch>,
}

#[derive(Deserialize)]
pub struct Packet {
    pub center: f64,
    pub wavelength: f64,
    pub cycles: f64,
    pub strain: f64,
    pub axis: usize,
    pub direction: f64,
    pub polarization: String,
    pub tilt: f64,
}

#[derive(Deserialize)]
pub struct Velocity {
    pub velocity: Pair,
    pub r#box: Option<Vec<Pair>>,
    pub gradient: Option<[Pair; 2]>,
    pub center: Option<Pair>,
}

#[derive(Deserialize)]
pub struct Stretch {
    pub gradient: [Pair; 2],
    pub center: Option<Pair>,
}

impl Plan {
    pub fn load(run_dir: &Path) -> Result<Plan, Failure> {
        let path = run_dir.join("plan.yaml");
        let trouble = |error: String| Failure::Input(format!("{}: {error}", path.display()));
        let bytes = fs::read(&path).map_err(|e| trouble(e.to_string()))?;
        let size: Size = serde_norway::from_slice(&bytes).map_err(|e| trouble(e.to_string()))?;
        if size.dim != 2 {
            return Err(refusal("domain.box: it has two dimensions"));
        }
        let mut plan: Plan =
            serde_norway::from_slice(&bytes).map_err(|e| trouble(e.to_string()))?;
        plan.digest = hex(&Sha256::digest(&bytes));
        Ok(plan)
    }

    pub fn cell(&self) -> f64 {
        self.level_cells[0]
    }

    /// Whether the state at a step is to be computed anew, as it is after a checkpoint.
    pub fn renews(&self, step: i64) -> bool {
        self.checkpoint.as_ref().is_some_and(|wanted| step > 0 && step % wanted.every == 0)
    }

    /// Whether each renewal is a checkpoint too.
    pub fn saves(&self, step: i64) -> bool {
        self.renews(step) && self.checkpoint.as_ref().is_some_and(|wanted| wanted.seconds.is_none())
    }

    pub fn faces(&self) -> [(usize, usize, &'static str, &Parts); 4] {
        let b = &self.boundary;
        [
            (0, 0, "left", &b.left),
            (0, 1, "right", &b.right),
            (1, 0, "bottom", &b.bottom),
            (1, 1, "top", &b.top),
        ]
    }

    /// Refuse what this service does not have.
    pub fn check(&self) -> Result<(), Failure> {
        let c = &self.continuum;
        let scheme = self.coupling.as_ref().map_or("force", |coupling| coupling.scheme.as_str());
        let mut refused = vec![
            (self.level_cells.len() > 1, "grid.levels: it has one level".to_string()),
            (scheme != "force", format!("coupling.scheme: {scheme}: it has the scheme force")),
            (c.ranks > 1, "continuum.ranks: it runs on one rank".into()),
            (c.temperature.is_some(), "continuum.temperature: it has no thermal stress".into()),
            (c.flip < 1.0 || !c.damping.is_empty(), "continuum.damping: it has no damping".into()),
            (c.body_force.is_some(), "continuum.body_force: it has none".into()),
            // in a coupled run the atoms hold the cracks
            (
                !c.cracks.is_empty() && self.coupling.is_none(),
                "continuum.cracks: it has none".into(),
            ),
            (
                self.initial.packets.iter().any(|packet| packet.tilt != 0.0),
                "initial.packets: its packets are not tilted".into(),
            ),
        ];
        for (_, _, name, parts) in self.faces() {
            let known = match parts {
                Parts::Several(_) => false,
                Parts::Whole(face) => {
                    let conditions = ["free", "traction", "velocity", "displacement", "symmetry"];
                    let uniform = matches!(face.value, Value::Components(_));
                    conditions.contains(&face.condition.as_str())
                        && uniform
                        && face.extent.is_empty()
                }
            };
            let reason = "it has tractions, velocities, displacements and symmetry on whole faces";
            refused.push((!known, format!("boundary.{name}: {reason}")));
        }
        for interface in self.coupling.iter().flat_map(|coupling| &coupling.interfaces) {
            let axes: Vec<usize> =
                (0..2).filter(|a| interface.planes[*a].iter().any(|p| p.is_finite())).collect();
            let across = axes.len() == 1 && self.domain.periodic[1 - axes[0]];
            let reason = "it has planes that run across a periodic axis, without corners";
            refused.push((!across, format!("coupling.planes: {reason}")));
        }
        match refused.into_iter().find(|(is, _)| *is) {
            Some((_, reason)) => Err(refusal(&reason)),
            None => Ok(()),
        }
    }
}

impl Face {
    /// Factor of the value at a time: a ramp from zero, or a piecewise linear history.
    pub fn factor(&self, time: f64) -> f64 {
        match self.history[..] {
            [] if self.ramp <= 0.0 => 1.0,
            [] => (time / self.ramp).clamp(0.0, 1.0),
            [first, ..] if time <= first[0] => first[1],
            [.., last] if time >= last[0] => last[1],
            _ => {
                let next = self.history.iter().position(|[t, _]| *t > time).unwrap_or(1);
                let ([t0, a], [t1, b]) = (self.history[next - 1], self.history[next]);
                a + (b - a) * (time - t0) / (t1 - t0)
            }
        }
    }

    pub fn components(&self, axis: usize) -> [Option<f64>; 2] {
        match &self.value {
            _ if self.condition == "symmetry" => {
                let mut normal = [None, None];
                normal[axis] = Some(0.0);
                normal
            }
            Value::Components(values) if values.len() == 2 => [values[0], values[1]],
            _ => [None, None],
        }
    }
}

pub fn refusal(reason: &str) -> Failure {
    Failure::Input(format!(
        "foreign-service cannot do what the case asks for: {reason}; change the case, or leave out \
         continuum.command"
    ))
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(ramp: f64, history: &[Pair]) -> Face {
        let value = Value::Components(vec![Some(1.0), None]);
        let (condition, history) = ("velocity".into(), history.to_vec());
        Face { condition, value, ramp, history, extent: Vec::new() }
    }

    #[test]
    fn a_value_grows_along_its_ramp_or_follows_its_history() {
        let ramp = face(2.0, &[]);
        assert_eq!([-1.0, 0.5, 3.0].map(|t| ramp.factor(t)), [0.0, 0.25, 1.0]);
        let history = face(0.0, &[[1.0, 0.0], [2.0, 4.0], [4.0, -4.0]]);
        assert_eq!(
            [0.0, 1.5, 2.0, 3.5, 9.0].map(|t| history.factor(t)),
            [0.0, 2.0, 4.0, -2.0, -4.0]
        );
        assert_eq!(face(0.0, &[]).factor(-1.0), 1.0);
    }
}
