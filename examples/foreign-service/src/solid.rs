//! The continuum: bilinear square finite elements, lumped masses, leapfrog steps.
//!
//! Displacements u are known at whole steps, velocities v in the middle between two. Nodes are the
//! ids of the shared grid.

use serde_json::{json, Value};

use crate::bonds::{apply, Bonds};
use crate::failure::Failure;
use crate::grid::{Grid, Weights};
use crate::initial::initial_state;
use crate::interface::{check_balance, normal, rods, shared_nodes, Rod};
use crate::plan::{refusal, Face, Interface, Material, Pair, Parts, Plan};
use crate::units::Units;

/// Share of a cell that is rounding.
const ROUNDING: f64 = 1e-9;
/// Norm of the strain up to which small strains are small.
const SMALL: f64 = 0.1;

/// A quadrature point: its nodes, the gradients of their shape functions, and its area.
struct Point {
    nodes: [usize; 4],
    gradients: [Pair; 4],
    area: f64,
    place: Pair,
}

pub enum Law {
    /// Stiffness in the order xx, yy, xy, with engineering shear; small strains.
    Linear([[f64; 3]; 3]),
    /// A crystal of bonds, with the area of a site; finite strains up to a limit.
    Crystal { bonds: Bonds, area: f64, limit: f64 },
}

/// A velocity component that some nodes have.
struct Motion {
    face: Face,
    nodes: Vec<usize>,
    component: usize,
    value: f64,
}

/// Nodal forces in proportion to a function of time.
struct Traction {
    face: Face,
    force: Vec<(usize, Pair)>,
}

pub struct Solid {
    pub grid: Grid,
    /// Ids of the nodes whose velocities the atoms need, and that get their forces.
    pub shared: Vec<i64>,
    pub u: Vec<Pair>,
    pub v: Vec<Pair>,
    /// Forces of the atoms on the shared nodes.
    pub force: Vec<Pair>,
    pub interface_work: f64,
    pub external_work: f64,
    dt: f64,
    units: Units,
    law: Law,
    mass: Vec<f64>,
    points: Vec<Point>,
    crystal: Option<Bonds>,
    rods: Vec<Rod>,
    motions: Vec<Motion>,
    tractions: Vec<Traction>,
    /// Forces of elements and rods at the present displacements, and the energy of both.
    internal: Vec<Pair>,
    potential: f64,
}

impl Solid {
    pub fn new(plan: &Plan) -> Result<Solid, Failure> {
        let (grid, units) = (Grid::new(plan), Units::of(&plan.units)?);
        let (density, law) = law(&plan.continuum.material, &units)?;
        let no_interfaces = Vec::new();
        let interfaces = plan.coupling.as_ref().map_or(&no_interfaces, |c| &c.interfaces);
        let mut solid = Solid {
            shared: plan.coupling.as_ref().map_or(Vec::new(), |c| shared_nodes(c, &grid)),
            u: vec![[0.0; 2]; grid.size()],
            v: vec![[0.0; 2]; grid.size()],
            force: Vec::new(),
            interface_work: 0.0,
            external_work: 0.0,
            dt: plan.step,
            units,
            law,
            mass: vec![0.0; grid.size()],
            points: Vec::new(),
            crystal: None,
            rods: Vec::new(),
            motions: Vec::new(),
            tractions: Vec::new(),
            internal: Vec::new(),
            potential: 0.0,
            grid,
        };
        solid.force = vec![[0.0; 2]; solid.shared.len()];
        let parts = parts(&solid.grid, interfaces);
        for part in &parts {
            solid.add_part(*part, density);
        }
        if let Some(crystal) = plan.coupling.as_ref().and_then(|c| c.crystal.as_ref()) {
            let bonds = Bonds::new(&crystal.bonds, &crystal.energy, solid.units.energy);
            for interface in interfaces {
                let mut found = rods(crystal, &bonds, interface, &solid.grid)?;
                solid.rods.append(&mut found);
            }
            let elements = |P, force: &mut [Pair]| {
                solid.points.iter().for_each(|point| point.add_forces(P, force));
            };
            check_balance(crystal, &bonds, &solid.rods, &solid.grid, elements)?;
            solid.crystal = Some(bonds);
        }
        solid.add_conditions(plan, &parts);
        for (node, id) in solid.grid.nodes() {
            if solid.mass[id] > 0.0 {
                let wave_speed = |along, moved| solid.wave_speed(density, along, moved);
                let x = solid.grid.position(node);
                (solid.u[id], solid.v[id]) = initial_state(&plan.initial, x, wave_speed);
            }
        }
        Ok(solid)
    }

    pub fn summary(&self) -> String {
        let nodes = self.mass.iter().filter(|mass| **mass > 0.0).count();
        format!("{nodes} nodes, {} rods", self.rods.len())
    }

    /// Velocities of the last step on the shared nodes.
    pub fn velocities(&self) -> Vec<Pair> {
        self.shared.iter().map(|id| self.v[*id as usize]).collect()
    }

    /// Evaluate elements and rods at the present displacements.
    pub fn finish(&mut self) {
        self.internal = vec![[0.0; 2]; self.u.len()];
        self.potential = 0.0;
        for point in &self.points {
            let (energy, P) = self.law.stress(point.displacement_gradient(&self.u));
            self.potential += point.area * energy;
            point.add_forces(P, &mut self.internal);
        }
        for rod in &self.rods {
            let bonds = self.crystal.as_ref().expect("rods belong to a crystal");
            self.potential += rod.evaluate(bonds, &self.u, &mut self.internal);
        }
    }

    /// Take the present forces of the atoms. `first`: no step has been taken.
    pub fn receive(&mut self, force: Vec<Pair>, first: bool) {
        for (k, id) in self.shared.iter().enumerate() {
            for a in 0..2 {
                let moved = if first { 0.0 } else { self.dt * self.v[*id as usize][a] };
                self.interface_work += 0.5 * (self.force[k][a] + force[k][a]) * moved;
            }
        }
        self.force = force;
    }

    /// Advance from step k to the next one, and return the energies at step k.
    pub fn advance(&mut self, step: i64) -> Value {
        let (change, loads) = self.kick(step, 1.0);
        let mut middle = self.v.clone();
        for id in 0..self.v.len() {
            for a in 0..2 {
                // at the start the velocity is that of the start, not of half a step before it
                middle[id][a] += if step == 0 { 0.0 } else { 0.5 * change[id][a] };
            }
        }
        let half = if step == 0 { 0.0 } else { 0.5 };
        let work = loads_work(&loads, &self.v, &change);
        let energies = self.energies(&middle, self.external_work + half * work);
        self.external_work += work;
        for id in 0..self.v.len() {
            for a in 0..2 {
                self.v[id][a] += change[id][a];
                self.u[id][a] += self.dt * self.v[id][a];
            }
        }
        energies
    }

    /// Energies at step k, from which the continuum does not advance.
    pub fn energies_at_end(&self, step: i64) -> Value {
        if step == 0 {
            return self.energies(&self.v, 0.0);
        }
        let (change, loads) = self.kick(step, 0.5);
        let mut v = self.v.clone();
        let mut work = self.external_work;
        for id in 0..v.len() {
            for a in 0..2 {
                v[id][a] += change[id][a];
                work += loads[id][a] * v[id][a];
            }
        }
        self.energies(&v, work)
    }

    /// What a monitor of strains finds: the material is strained beyond the reach of its law.
    pub fn findings(&self) -> Vec<Value> {
        let limit = match &self.law {
            Law::Linear(_) => SMALL,
            Law::Crystal { limit, .. } => *limit,
        };
        let strains = self.points.iter().map(|point| {
            let [[a, b], [c, d]] = point.displacement_gradient(&self.u);
            ((a * a + d * d + 0.5 * (b + c).powi(2)).sqrt(), point.place)
        });
        let (most, place) =
            strains.fold((0.0, [0.0; 2]), |best, new| if new.0 > best.0 { new } else { best });
        if most <= limit {
            return Vec::new();
        }
        vec![json!({"kind": "strain", "value": most.min(f64::MAX), "limit": limit, "place": place})]
    }

    /// Change of the velocity by a share of the kick of step k, and the impulses of loads.
    ///
    /// The kick leads from the middle of the last step, or from the start, to that of the next.
    fn kick(&self, step: i64, share: f64) -> (Vec<Pair>, Vec<Pair>) {
        let time = step as f64 * self.dt;
        let span = share * if step == 0 { 0.5 * self.dt } else { self.dt };
        let mut loads = vec![[0.0; 2]; self.v.len()];
        for traction in &self.tractions {
            for (id, force) in &traction.force {
                for a in 0..2 {
                    loads[*id][a] += span * traction.face.factor(time) * force[a];
                }
            }
        }
        let mut impulse = self.internal.clone();
        for id in 0..impulse.len() {
            for a in 0..2 {
                impulse[id][a] = span * impulse[id][a] + loads[id][a];
            }
        }
        for (id, force) in self.shared.iter().zip(&self.force) {
            for a in 0..2 {
                impulse[*id as usize][a] += span * force[a];
            }
        }
        for motion in &self.motions {
            let a = motion.component;
            for id in &motion.nodes {
                let change = share * (motion.velocity(time, self.dt) - self.v[*id][a]);
                let reaction = self.mass[*id] * change - impulse[*id][a];
                loads[*id][a] += reaction;
                impulse[*id][a] += reaction;
            }
        }
        for (impulse, mass) in impulse.iter_mut().zip(&self.mass) {
            *impulse = impulse.map(|x| if *mass > 0.0 { x / mass } else { 0.0 });
        }
        (impulse, loads)
    }

    fn energies(&self, v: &[Pair], external_work: f64) -> Value {
        let (mut kinetic, mut momentum) = (0.0, [0.0; 2]);
        for (v, mass) in v.iter().zip(&self.mass) {
            for a in 0..2 {
                kinetic += 0.5 * mass * v[a] * v[a];
                momentum[a] += mass * v[a];
            }
        }
        let unit = self.units.energy;
        json!({
            "kinetic": kinetic / unit,
            "potential": self.potential / unit,
            "external_work": external_work / unit,
            "interface_work": self.interface_work / unit,
            "dissipated": 0.0,
            "mass": self.mass.iter().sum::<f64>(),
            "momentum": momentum,
        })
    }

    fn wave_speed(&self, density: f64, along: usize, moved: usize) -> f64 {
        let row = if along == moved { along } else { 2 };
        (self.law.stiffness()[row][row] / density).sqrt()
    }

    /// Quadrature points and masses of the part of a cell that belongs to the continuum.
    fn add_part(&mut self, Part { cell, low, high }: Part, density: f64) {
        let h = self.grid.h;
        let corner = |i: i64, j: i64| self.grid.id([cell[0] + i, cell[1] + j]);
        let nodes = [corner(0, 0), corner(0, 1), corner(1, 0), corner(1, 1)];
        let origin = self.grid.position(cell);
        let area = 0.25 * (high[0] - low[0]) * (high[1] - low[1]);
        let gauss = 1.0 / 3f64.sqrt();
        for (i, j) in [(-gauss, -gauss), (-gauss, gauss), (gauss, -gauss), (gauss, gauss)] {
            let place = [
                0.5 * (low[0] + high[0] + i * (high[0] - low[0])),
                0.5 * (low[1] + high[1] + j * (high[1] - low[1])),
            ];
            let [s, t] = [(place[0] - origin[0]) / h, (place[1] - origin[1]) / h];
            let gradients = [
                [-(1.0 - t) / h, -(1.0 - s) / h],
                [-t / h, (1.0 - s) / h],
                [(1.0 - t) / h, -s / h],
                [t / h, s / h],
            ];
            let values = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
            for (id, value) in nodes.iter().zip(values) {
                self.mass[*id] += density * area * value;
            }
            self.points.push(Point { nodes, gradients, area, place });
        }
    }

    fn add_conditions(&mut self, plan: &Plan, parts: &[Part]) {
        for (axis, side, _, whole) in plan.faces() {
            let Parts::Whole(face) = whole else { continue }; // `check` has refused the others
            let index = if side == 0 { 0 } else { self.grid.cells[axis] };
            if face.condition == "traction" {
                let force = self.traction_forces(face, axis, index, parts);
                self.tractions.push(Traction { face: face.clone(), force });
            } else if face.condition != "free" {
                let nodes = self.grid.nodes().into_iter();
                let nodes: Vec<usize> = nodes
                    .filter(|(node, id)| node[axis] == index && self.mass[*id] > 0.0)
                    .map(|(_, id)| id)
                    .collect();
                for (component, value) in face.components(axis).into_iter().enumerate() {
                    if let Some(value) = value {
                        let (face, nodes) = (face.clone(), nodes.clone());
                        self.motions.push(Motion { face, nodes, component, value });
                    }
                }
            }
        }
    }

    /// Shares of the nodes in a uniform traction. A hat function in the middle of an edge is its
    /// mean over the edge.
    fn traction_forces(
        &self,
        face: &Face,
        axis: usize,
        index: i64,
        parts: &[Part],
    ) -> Vec<(usize, Pair)> {
        let place = self.grid.low[axis] + index as f64 * self.grid.h;
        let value = face.components(axis).map(|x| self.units.pressure * x.unwrap_or(0.0));
        let mut force = Vec::new();
        for part in parts {
            let touches = [part.low[axis], part.high[axis]]
                .iter()
                .any(|end| (end - place).abs() < ROUNDING * self.grid.h);
            if touches {
                let length = part.high[1 - axis] - part.low[1 - axis];
                let mut middle = [0, 1].map(|a| 0.5 * (part.low[a] + part.high[a]));
                middle[axis] = place;
                let hats: Weights = self.grid.hats(middle);
                force.extend(hats.into_iter().map(|(id, w)| (id, value.map(|x| w * length * x))));
            }
        }
        force
    }
}

impl Point {
    fn displacement_gradient(&self, u: &[Pair]) -> [Pair; 2] {
        let mut H = [[0.0; 2]; 2];
        for (id, gradient) in self.nodes.iter().zip(&self.gradients) {
            for i in 0..2 {
                for j in 0..2 {
                    H[i][j] += u[*id][i] * gradient[j];
                }
            }
        }
        H
    }

    fn add_forces(&self, P: [Pair; 2], force: &mut [Pair]) {
        for (id, gradient) in self.nodes.iter().zip(&self.gradients) {
            let pull = apply(P, *gradient);
            for a in 0..2 {
                force[*id][a] -= self.area * pull[a];
            }
        }
    }
}

impl Law {
    /// Strain energy density and first Piola-Kirchhoff stress at a displacement gradient.
    fn stress(&self, H: [Pair; 2]) -> (f64, [Pair; 2]) {
        match self {
            Law::Linear(C) => {
                let strain = [H[0][0], H[1][1], H[0][1] + H[1][0]];
                let stress = C.map(|row| (0..3).map(|k| row[k] * strain[k]).sum::<f64>());
                let energy = 0.5 * (0..3).map(|k| stress[k] * strain[k]).sum::<f64>();
                (energy, [[stress[0], stress[2]], [stress[2], stress[1]]])
            }
            Law::Crystal { bonds, area, .. } => {
                bonds.stress([[1.0 + H[0][0], H[0][1]], [H[1][0], 1.0 + H[1][1]]], *area)
            }
        }
    }

    /// Stiffness at rest; of a crystal by differences of its stress.
    fn stiffness(&self) -> [[f64; 3]; 3] {
        match self {
            Law::Linear(C) => *C,
            Law::Crystal { .. } => {
                let e = 1e-6;
                let modes = [
                    [[e, 0.0], [0.0, 0.0]],
                    [[0.0, 0.0], [0.0, e]],
                    [[0.0, 0.5 * e], [0.5 * e, 0.0]],
                ];
                let mut C = [[0.0; 3]; 3];
                for (k, H) in modes.into_iter().enumerate() {
                    let (up, down) =
                        (self.stress(H).1, self.stress(H.map(|row| row.map(|x| -x))).1);
                    for (l, (i, j)) in [(0, 0), (1, 1), (0, 1)].into_iter().enumerate() {
                        C[l][k] = (up[i][j] - down[i][j]) / (2.0 * e);
                    }
                }
                C
            }
        }
    }
}

impl Motion {
    /// Velocity in the step from a time.
    fn velocity(&self, time: f64, dt: f64) -> f64 {
        let rate = if self.face.condition == "displacement" {
            (self.face.factor(time + dt) - self.face.factor(time)) / dt
        } else {
            self.face.factor(time + 0.5 * dt)
        };
        rate * self.value
    }
}

/// Density and law of a material, in mechanical units.
fn law(material: &Material, units: &Units) -> Result<(f64, Law), Failure> {
    match material {
        Material::Moduli { density, lame, shear, model, plane } if model == "linear" => {
            let (mut l, m) = (lame * units.pressure, shear * units.pressure);
            if plane == "stress" {
                l = 2.0 * l * m / (l + 2.0 * m);
            }
            let C = [[l + 2.0 * m, l, 0.0], [l, l + 2.0 * m, 0.0], [0.0, 0.0, m]];
            Ok((*density, Law::Linear(C)))
        }
        Material::Stiffness { density, stiffness } => {
            let C = stiffness.map(|row| row.map(|x| x * units.pressure));
            Ok((*density, Law::Linear(C)))
        }
        Material::Lattice { density, area, bonds, energy, stretch_limit } => {
            let bonds = Bonds::new(bonds, energy, units.energy);
            // s - 1 of a bond is at most twice the strain, to first order
            Ok((*density, Law::Crystal { bonds, area: *area, limit: 0.5 * stretch_limit }))
        }
        _ => Err(refusal("continuum.material: it has linear elasticity and the crystal of bonds")),
    }
}

/// A rectangle of a cell that belongs to the continuum.
#[derive(Clone, Copy)]
struct Part {
    cell: [i64; 2],
    low: Pair,
    high: Pair,
}

/// The cells of the domain without what lies inside the planes.
fn parts(grid: &Grid, interfaces: &[Interface]) -> Vec<Part> {
    let mut parts = Vec::new();
    for i in 0..grid.cells[0] {
        for j in 0..grid.cells[1] {
            let cell = [i, j];
            parts.push(Part {
                cell,
                low: grid.position(cell),
                high: grid.position([i + 1, j + 1]),
            });
        }
    }
    for interface in interfaces {
        let (axis, least) = (normal(interface), ROUNDING * grid.h);
        let [low, high] = interface.planes[axis];
        parts = parts
            .into_iter()
            .flat_map(|part| {
                let (mut below, mut above) = (part, part);
                below.high[axis] = part.high[axis].min(low);
                above.low[axis] = part.low[axis].max(high);
                [below, above]
            })
            .filter(|part| part.high[axis] - part.low[axis] > least)
            .collect();
    }
    parts
}

/// Work of the impulses of loads over a kick: the velocity is that in the middle of the kick.
fn loads_work(loads: &[Pair], v: &[Pair], change: &[Pair]) -> f64 {
    let all = loads.iter().zip(v).zip(change);
    all.map(|((load, v), change)| (0..2).map(|a| load[a] * (v[a] + 0.5 * change[a])).sum::<f64>())
        .sum()
}
