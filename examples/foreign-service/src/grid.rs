//! The background grid that both sides share, and its hat functions.

use crate::plan::Plan;

/// Layers of nodes beyond the domain.
const PAD: i64 = 2;

pub struct Grid {
    pub low: [f64; 2],
    pub h: f64,
    pub cells: [i64; 2],
    pub periodic: [bool; 2],
}

/// Nodes, by their ids, with a weight each.
pub type Weights = Vec<(usize, f64)>;

impl Grid {
    pub fn new(plan: &Plan) -> Grid {
        let h = plan.cell();
        let along = |axis: usize| plan.domain.r#box[axis];
        let cells = |axis: usize| ((along(axis)[1] - along(axis)[0]) / h).round() as i64;
        Grid {
            low: [along(0)[0], along(1)[0]],
            h,
            cells: [cells(0), cells(1)],
            periodic: [plan.domain.periodic[0], plan.domain.periodic[1]],
        }
    }

    pub fn size(&self) -> usize {
        ((self.cells[0] + 1 + 2 * PAD) * (self.cells[1] + 1 + 2 * PAD)) as usize
    }

    /// Id of a node; a periodic image has the id of the node that it repeats.
    pub fn id(&self, node: [i64; 2]) -> usize {
        let place = |axis: usize| {
            let index = node[axis];
            PAD + if self.periodic[axis] { index.rem_euclid(self.cells[axis]) } else { index }
        };
        (place(0) * (self.cells[1] + 1 + 2 * PAD) + place(1)) as usize
    }

    /// Indices of all nodes that are no images, with their ids.
    pub fn nodes(&self) -> Vec<([i64; 2], usize)> {
        let range = |axis: usize| {
            let n = self.cells[axis];
            if self.periodic[axis] {
                0..n
            } else {
                -PAD..n + 1 + PAD
            }
        };
        let all = range(0).flat_map(|i| range(1).map(move |j| [i, j]));
        all.map(|node| (node, self.id(node))).collect()
    }

    /// Whether a node lies in the domain or on its faces.
    pub fn contains(&self, node: [i64; 2]) -> bool {
        (0..2).all(|axis| (0..=self.cells[axis]).contains(&node[axis]))
    }

    pub fn position(&self, node: [i64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.low[axis] + self.h * node[axis] as f64)
    }

    pub fn high(&self, axis: usize) -> f64 {
        self.low[axis] + self.h * self.cells[axis] as f64
    }

    /// Hat functions at a place.
    pub fn hats(&self, x: [f64; 2]) -> Weights {
        let along = |axis: usize| {
            let t = (x[axis] - self.low[axis]) / self.h;
            let first = t.floor();
            [(first as i64, 1.0 - (t - first)), (first as i64 + 1, t - first)]
        };
        self.product(&along(0), &along(1))
    }

    /// Means of the hat functions over a segment about a place, along an axis.
    pub fn means(&self, x: [f64; 2], axis: usize, length: f64) -> Weights {
        let across = 1 - axis;
        let t = (x[axis] - self.low[axis]) / self.h;
        let (a, b) = (t - 0.5 * length / self.h, t + 0.5 * length / self.h);
        let nodes = a.floor() as i64..=b.ceil() as i64;
        let along: Vec<(i64, f64)> = nodes
            .map(|node| (node, (integral(b - node as f64) - integral(a - node as f64)) / (b - a)))
            .collect();
        let s = (x[across] - self.low[across]) / self.h;
        let first = s.floor();
        let beside = [(first as i64, 1.0 - (s - first)), (first as i64 + 1, s - first)];
        if axis == 0 {
            self.product(&along, &beside)
        } else {
            self.product(&beside, &along)
        }
    }

    fn product(&self, first: &[(i64, f64)], second: &[(i64, f64)]) -> Weights {
        let mut weights = Weights::new();
        for (i, a) in first {
            for (j, b) in second {
                if a * b != 0.0 {
                    add(&mut weights, self.id([*i, *j]), a * b);
                }
            }
        }
        weights
    }
}

/// Add a weight to that of a node.
pub fn add(weights: &mut Weights, node: usize, weight: f64) {
    match weights.iter_mut().find(|(known, _)| *known == node) {
        Some((_, sum)) => *sum += weight,
        None => weights.push((node, weight)),
    }
}

/// Integral of the hat function `1 - |t|` up to t.
fn integral(t: f64) -> f64 {
    let t = t.clamp(-1.0, 1.0);
    if t < 0.0 {
        0.5 * (1.0 + t).powi(2)
    } else {
        1.0 - 0.5 * (1.0 - t).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid { low: [1.0, -2.0], h: 0.5, cells: [7, 4], periodic: [false, true] }
    }

    #[test]
    fn ids_follow_the_formula_and_images_repeat() {
        assert_eq!(grid().id([3, 2]), (3 + 2) * (4 + 5) + (2 + 2));
        assert_eq!(grid().id([3, 6]), grid().id([3, 2]));
    }

    #[test]
    fn weights_are_a_partition_of_one_and_reproduce_a_place() {
        let g = grid();
        for weights in [g.hats([2.13, -1.61]), g.means([2.13, -1.61], 0, 1.7)] {
            let sum: f64 = weights.iter().map(|(_, w)| w).sum();
            let nodes = g.nodes();
            let x: f64 = weights
                .iter()
                .map(|(id, w)| w * g.position(nodes.iter().find(|(_, i)| i == id).unwrap().0)[0])
                .sum();
            assert!((sum - 1.0).abs() < 1e-14 && (x - 2.13).abs() < 1e-14);
        }
    }
}
