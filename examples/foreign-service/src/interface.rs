//! The interface of the force scheme: the nodes that both sides share, and the rods.
//!
//! A rod is the part of a bond to a ghost atom that lies in the continuum. Its energy is counted in
//! the continuum already, so it is subtracted:
//! `E = -theta phi(R + (u(ghost) - u(crossing)) / theta)`.

use crate::bonds::{apply, dot, Bonds};
use crate::failure::Failure;
use crate::grid::{add, Grid, Weights};
use crate::plan::{Coupling, Crystal, Interface, Pair};

/// Share of a cell that is rounding.
const ROUNDING: f64 = 1e-6;
/// Share of a cell by which a node must be nearer than a distance that it may not have.
const STRICT: f64 = 1e-9;
/// Distances from the planes, in cells, between which the absorber sees nodes.
const SEEN: [f64; 2] = [1.0, 4.0];
/// Largest force that uniform strain may leave on a node, over the traction on a cell.
const BALANCED: f64 = 1e-9;

pub struct Rod {
    bond: usize,
    sign: f64,
    theta: f64,
    /// Weights by which nodes move the crossing.
    crossing: Weights,
    /// Weights of `u(ghost) - u(crossing)`.
    stretch: Weights,
}

/// Ids, in increasing order, of the nodes whose velocities the atoms need, and that get their forces.
pub fn shared_nodes(coupling: &Coupling, grid: &Grid) -> Vec<i64> {
    let interfaces = &coupling.interfaces;
    let shared = |node: [i64; 2]| {
        let x = grid.position(node);
        interfaces.iter().any(|interface| moves_ghosts(interface, x, grid.h))
            || coupling.absorber.is_some() && grid.contains(node) && is_seen(interfaces, x, grid.h)
    };
    let chosen = grid.nodes().into_iter().filter(|(node, _)| shared(*node));
    let mut ids: Vec<i64> = chosen.map(|(_, id)| id as i64).collect();
    ids.sort();
    ids
}

/// Whether a node is less than a cell away from a ghost atom.
fn moves_ghosts(interface: &Interface, x: Pair, h: f64) -> bool {
    let h = (1.0 - STRICT) * h;
    let near = (0..2).all(|axis| {
        let [start, end] = interface.region[axis];
        x[axis] > start - h && x[axis] < end + h
    });
    let deep = (0..2).all(|axis| {
        let [low, high] = interface.planes[axis];
        x[axis] > low + h && x[axis] < high - h
    });
    near && !deep
}

/// Whether the absorber sees a node, by its distance from the nearest planes.
fn is_seen(interfaces: &[Interface], x: Pair, h: f64) -> bool {
    let outside = |interface: &Interface| {
        let beyond = |axis: usize| {
            let [low, high] = interface.planes[axis];
            (low - x[axis]).max(x[axis] - high)
        };
        beyond(0).max(beyond(1))
    };
    let distance = interfaces.iter().map(outside).fold(f64::INFINITY, f64::min);
    distance > (SEEN[0] + STRICT) * h && distance < (SEEN[1] - STRICT) * h
}

/// The axis along which the planes of an interface lie one behind the other.
pub fn normal(interface: &Interface) -> usize {
    usize::from(interface.planes[0].iter().all(|plane| plane.is_infinite()))
}

/// All rods of an interface; its planes run across the domain.
pub fn rods(
    crystal: &Crystal,
    bonds: &Bonds,
    interface: &Interface,
    grid: &Grid,
) -> Result<Vec<Rod>, Failure> {
    let (axis, margin) = (normal(interface), ROUNDING * grid.h);
    let [low, high] = interface.planes[axis];
    let period = row_period(crystal, 1 - axis)?;
    let mut rods = Vec::new();
    for free in free_sites(crystal, bonds, interface, grid) {
        for (bond, R) in bonds.vectors.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let ghost = [free[0] + sign * R[0], free[1] + sign * R[1]];
                let plane = if ghost[axis] < low {
                    low
                } else if ghost[axis] > high {
                    high
                } else {
                    continue; // the other end is a free atom too
                };
                if ghost[axis] < grid.low[axis] - margin || ghost[axis] > grid.high(axis) + margin {
                    continue; // the crystal ends at a face of the domain
                }
                let [start, end] = interface.region[axis];
                if ghost[axis] < start - margin || ghost[axis] > end + margin {
                    return Err(Failure::Input(format!(
                        "coupling.planes: ghost atoms beyond the plane at {plane} lie outside \
                         md.region"
                    )));
                }
                let inside = (plane - free[axis]) / (ghost[axis] - free[axis]);
                let mut place = [free[0] + inside * sign * R[0], free[1] + inside * sign * R[1]];
                place[axis] = plane;
                let crossing = grid.means(place, 1 - axis, period);
                let mut stretch = grid.hats(ghost);
                for (node, weight) in &crossing {
                    add(&mut stretch, *node, -weight);
                }
                rods.push(Rod { bond, sign, theta: 1.0 - inside, crossing, stretch });
            }
        }
    }
    Ok(rods)
}

impl Rod {
    /// Energy at nodal displacements; adds the forces on the nodes.
    pub fn evaluate(&self, bonds: &Bonds, u: &[Pair], force: &mut [Pair]) -> f64 {
        let R = bonds.vectors[self.bond];
        let mut r = R.map(|x| self.sign * x);
        for (node, weight) in &self.stretch {
            for k in 0..2 {
                r[k] += weight * u[*node][k] / self.theta;
            }
        }
        let (energy, q) = bonds.evaluate(self.bond, r);
        for (node, weight) in &self.stretch {
            for k in 0..2 {
                force[*node][k] += weight * q[k];
            }
        }
        -self.theta * energy
    }
}

/// Check that a uniformly strained crystal leaves no force on the nodes along the planes.
///
/// `elements` adds the forces of the elements for a stress that is the same everywhere. Rods and
/// ghost atoms together leave the force of the bond at the crossing.
pub fn check_balance(
    crystal: &Crystal,
    bonds: &Bonds,
    rods: &[Rod],
    grid: &Grid,
    elements: impl Fn([Pair; 2], &mut [Pair]),
) -> Result<(), Failure> {
    let [a, b] = crystal.vectors;
    let area = (a[0] * b[1] - a[1] * b[0]).abs();
    let e = 1e-3;
    for F in [[[1.0 + e, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.0 + e]], [[1.0, e], [0.0, 1.0]]] {
        let (_, P) = bonds.stress(F, area);
        let mut force = vec![[0.0; 2]; grid.size()];
        elements(P, &mut force);
        for rod in rods {
            let r = apply(F, bonds.vectors[rod.bond]).map(|x| rod.sign * x);
            let (_, q) = bonds.evaluate(rod.bond, r);
            for (node, weight) in &rod.crossing {
                for k in 0..2 {
                    force[*node][k] -= weight * q[k];
                }
            }
        }
        let inner = grid.nodes().into_iter().filter(|(node, _)| {
            (0..2).all(|a| grid.periodic[a] || (1..grid.cells[a]).contains(&node[a]))
        });
        let left = inner.map(|(_, id)| dot(force[id], force[id]).sqrt()).fold(0.0, f64::max);
        let traction = P.concat().iter().fold(0.0, |most: f64, x| most.max(x.abs())) * grid.h;
        if left > BALANCED * traction {
            return Err(Failure::Input(format!(
                "coupling.crystal: under uniform strain {:.1e} of the traction is left at a node \
                 near the planes; the crystal must repeat with the length of the domain along them",
                left / traction
            )));
        }
    }
    Ok(())
}

/// Sites of free atoms within a bond's length of a plane; across a periodic face each one once.
fn free_sites(crystal: &Crystal, bonds: &Bonds, interface: &Interface, grid: &Grid) -> Vec<Pair> {
    let axis = normal(interface);
    let (margin, reach) = (ROUNDING * grid.h, 1.001 * bonds.longest());
    let [low, high] = interface.planes[axis];
    let wanted = |x: Pair| {
        (0..2).all(|a| {
            let end = grid.high(a) + if grid.periodic[a] { -margin } else { margin };
            x[a] >= grid.low[a] - margin && x[a] < end
        }) && x[axis] > low
            && x[axis] < high
            && (x[axis] < low + reach || x[axis] > high - reach)
    };
    let corners = [0, 1, 2, 3].map(|k| {
        [
            if k % 2 == 0 { grid.low[0] } else { grid.high(0) },
            if k < 2 { grid.low[1] } else { grid.high(1) },
        ]
    });
    let indices =
        corners.map(|x| index(crystal, [x[0] - crystal.origin[0], x[1] - crystal.origin[1]]));
    let range = |k: usize| {
        let values = indices.map(|i| i[k]);
        let (least, most) = (
            values.iter().cloned().fold(f64::MAX, f64::min),
            values.iter().cloned().fold(f64::MIN, f64::max),
        );
        least.floor() as i64 - 1..=most.ceil() as i64 + 1
    };
    let all = range(0).flat_map(|i| range(1).map(move |j| [i as f64, j as f64]));
    let [a, b] = crystal.vectors;
    all.map(|[i, j]| [0, 1].map(|k| crystal.origin[k] + i * a[k] + j * b[k]))
        .filter(|x| wanted(*x))
        .collect()
}

/// Coordinates of a vector in terms of the primitive vectors.
fn index(crystal: &Crystal, x: Pair) -> Pair {
    let [a, b] = crystal.vectors;
    let area = a[0] * b[1] - a[1] * b[0];
    [(x[0] * b[1] - x[1] * b[0]) / area, (a[0] * x[1] - a[1] * x[0]) / area]
}

/// Shortest translation of the lattice along an axis.
fn row_period(crystal: &Crystal, axis: usize) -> Result<f64, Failure> {
    let [a, b] = crystal.vectors;
    let spacing = dot(a, a).max(dot(b, b)).sqrt();
    let steps = (-50..=50).flat_map(|i| (-50..=50).map(move |j| (i as f64, j as f64)));
    let rows = steps
        .map(|(i, j)| [0, 1].map(|k| i * a[k] + j * b[k]))
        .filter(|step| step[1 - axis].abs() < 1e-6 * spacing && step[axis] > 1e-6 * spacing);
    let shortest = rows.map(|step| step[axis]).fold(f64::INFINITY, f64::min);
    if shortest.is_finite() {
        return Ok(shortest);
    }
    Err(Failure::Input("coupling.crystal.vectors: no row of atoms runs along the planes".into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::IgnoredAny;

    /// A square crystal with bonds to nearest and diagonal neighbours, and a plane across it.
    fn strip() -> (Crystal, Bonds, Interface, Grid) {
        let vectors = [[1.0, 0.0], [0.0, 1.0]];
        let neighbours = vec![[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [-1.0, 1.0]];
        let energy = vec![vec![0.0, 5.0], vec![0.0, 5.0], vec![0.0, 3.0], vec![0.0, 3.0]];
        let bonds = Bonds::new(&neighbours, &energy, 1.0);
        let crystal = Crystal { vectors, origin: [0.0, 0.5], bonds: neighbours, energy };
        let interface = Interface {
            planes: vec![[10.5, f64::INFINITY], [f64::NEG_INFINITY, f64::INFINITY]],
            region: vec![[8.0, 20.0], [0.0, 8.0]],
        };
        let grid = Grid { low: [0.0, 0.0], h: 2.0, cells: [10, 4], periodic: [false, true] };
        (crystal, bonds, interface, grid)
    }

    #[test]
    fn the_absorber_sees_three_columns_of_nodes_in_the_body() {
        let (_, _, interface, grid) = strip();
        let columns = |absorber, planes| {
            let interfaces = vec![Interface { planes, region: interface.region.clone() }];
            let coupling = Coupling { scheme: "force".into(), crystal: None, interfaces, absorber };
            let ids = shared_nodes(&coupling, &grid);
            let all = grid.nodes().into_iter();
            let row = all.filter(|(node, id)| node[1] == 0 && ids.contains(&(*id as i64)));
            row.map(|(node, _)| node[0]).collect::<Vec<i64>>()
        };
        let across = |x| vec![[x, f64::INFINITY], [f64::NEG_INFINITY, f64::INFINITY]];
        assert_eq!(columns(None, across(10.5)), [4, 5, 6]);
        assert_eq!(columns(Some(IgnoredAny), across(10.5)), [2, 3, 4, 5, 6]);
        assert_eq!(columns(Some(IgnoredAny), across(10.0)), [2, 3, 4, 5]); // 1 and 4 cells away
        assert_eq!(columns(Some(IgnoredAny), across(4.5)), [0, 1]); // the body ends
    }

    #[test]
    fn each_bond_across_the_plane_is_one_rod() {
        let (crystal, bonds, interface, grid) = strip();
        let rods = rods(&crystal, &bonds, &interface, &grid).unwrap();
        assert_eq!(rods.len(), 3 * 8); // one straight and two diagonal ones for each of 8 rows
        assert!(rods.iter().all(|rod| (rod.theta - 0.5).abs() < 1e-12));
    }

    #[test]
    fn forces_of_rods_are_minus_the_derivative_of_their_energy() {
        let (crystal, bonds, interface, grid) = strip();
        let rods = rods(&crystal, &bonds, &interface, &grid).unwrap();
        let mut u = vec![[0.0; 2]; grid.size()];
        for (node, id) in grid.nodes() {
            u[id] = [0.01 * (node[0] * node[1]) as f64, -0.02 * node[1] as f64];
        }
        let energy = |u: &[Pair]| -> f64 {
            let mut unused = vec![[0.0; 2]; u.len()];
            rods.iter().map(|rod| rod.evaluate(&bonds, u, &mut unused)).sum()
        };
        let mut force = vec![[0.0; 2]; grid.size()];
        rods.iter().for_each(|rod| {
            rod.evaluate(&bonds, &u, &mut force);
        });
        let (node, step) = (grid.id([5, 1]), 1e-6);
        for axis in 0..2 {
            let (mut up, mut down) = (u.clone(), u.clone());
            up[node][axis] += step;
            down[node][axis] -= step;
            let slope = (energy(&up) - energy(&down)) / (2.0 * step);
            assert!((slope + force[node][axis]).abs() < 1e-7 * force[node][axis].abs().max(1.0));
        }
    }
}
