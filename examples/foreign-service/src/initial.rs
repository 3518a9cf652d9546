//! The state at the start: wave packets, a uniform stretch, and velocities in boxes.

use std::f64::consts::PI;

use crate::bonds::apply;
use crate::plan::{Initial, Pair};

/// Displacement and velocity at a place at rest. `wave_speed(along, moved)` is that of waves along
/// an axis that move the body along an axis.
pub fn initial_state(
    initial: &Initial,
    x: Pair,
    wave_speed: impl Fn(usize, usize) -> f64,
) -> (Pair, Pair) {
    let (mut u, mut v) = ([0.0; 2], [0.0; 2]);
    for packet in &initial.packets {
        let moved = if packet.polarization == "P" { packet.axis } else { 1 - packet.axis };
        let k = 2.0 * PI / packet.wavelength;
        let width = packet.cycles * packet.wavelength / 2.355;
        let xi = x[packet.axis] - packet.center;
        let envelope = packet.strain / k * (-xi * xi / (2.0 * width * width)).exp();
        let slope = -envelope * (xi / (width * width) * (k * xi).cos() + k * (k * xi).sin());
        u[moved] += envelope * (k * xi).cos();
        v[moved] -= packet.direction * wave_speed(packet.axis, moved) * slope;
    }
    let arm = |center: &Option<Pair>| {
        let center = center.unwrap_or([0.0; 2]);
        [x[0] - center[0], x[1] - center[1]]
    };
    if let Some(stretch) = &initial.stretch {
        let moved = apply(stretch.gradient, arm(&stretch.center));
        u = [u[0] + moved[0], u[1] + moved[1]];
    }
    for field in &initial.velocities {
        let inside = |range: &Vec<Pair>| (0..2).all(|a| x[a] >= range[a][0] && x[a] < range[a][1]);
        if field.r#box.as_ref().map_or(true, inside) {
            let turn =
                field.gradient.map_or([0.0; 2], |gradient| apply(gradient, arm(&field.center)));
            v = [0, 1].map(|a| v[a] + field.velocity[a] + turn[a]);
        }
    }
    (u, v)
}
