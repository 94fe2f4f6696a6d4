//! Reference problems that tests and benchmarks share; no one of them needs all.
#![allow(dead_code)]

use armonic_core::dynamics::{self, Workspace};

use armonic_core::impedance::{Direction, SpringDamper};
use armonic_core::linearize::{OperatingPoint, Tangent, linearize};
use armonic_core::mechanism::{Frame, Mechanism, Motion, Node};
use armonic_core::spatial::{Inertia, Transform, rotation};
use armonic_core::system::LinearSystem;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// N m/rad, in the order z1 x1 y1 z2 x2 y2 z3 x3 y3.
pub const STIFFNESS: [f64; 9] = [5.0e6, 6.1e6, 11.9e6, 6.9e6, 11.8e6, 8.1e6, 2.8e6, 5.2e6, 12.0e6];
/// N m s/rad, likewise.
pub const DAMPING: [f64; 9] = [20.0, 40.0, 3100.0, 2400.0, 40.0, 9400.0, 200.0, 9200.0, 80.0];

fn shift(x: f64, y: f64, z: f64) -> Transform {
    Transform { rotation: Matrix3::identity(), translation: Vector3::new(x, y, z) }
}

fn turn_x(angle: f64) -> Transform {
    Transform { rotation: rotation(&Vector3::x_axis(), angle), translation: Vector3::zeros() }
}

/// KUKA KR90 R3100 of Huynh et al. 2021, Tables 3 and 5 ("From [34]"); every joint turns about z, then x, then y.
pub fn kuka() -> Mechanism {
    let placements =
        [Transform::identity(), shift(0.35, 0.0, 0.0).then(&turn_x(FRAC_PI_2)), shift(1.35, 0.0, 0.0)];
    let masses = [511.726, 249.53, 222.659];
    let coms = [[-0.02, 0.0, -0.21], [0.53, 0.0, 0.25], [0.42, 0.02, -0.02]];
    let products = [
        [15.45, 30.90, 30.24, 1.87, 0.94, 0.37],
        [80.01, 150.62, 150.85, -1.06, 0.5, -0.07],
        [45.88, 125.93, 125.90, -1.37, 0.07, -1.20],
    ];
    let mut nodes: Vec<Node> = Vec::new();
    for link in 0..3 {
        let [xx, yy, zz, xy, xz, yz] = products[link];
        let tensor = Matrix3::new(xx, -xy, -xz, -xy, yy, -yz, -xz, -yz, zz);
        let inertia = Inertia::about_com(masses[link], Vector3::from(coms[link]), tensor);
        for (turn, axis) in [Vector3::z_axis(), Vector3::x_axis(), Vector3::y_axis()].into_iter().enumerate()
        {
            nodes.push(Node {
                parent: nodes.len().checked_sub(1),
                placement: if turn == 0 { placements[link] } else { Transform::identity() },
                motion: Motion::Revolute(axis),
                inertia: if turn == 2 { inertia } else { Inertia::zero() },
            });
        }
    }
    let sensor = shift(1.566, 0.042, 0.005).then(&turn_x(-FRAC_PI_2));
    let frame = Frame { node: Some(8), placement: sensor };
    Mechanism::new(nodes, vec![frame], Vector3::new(0.0, 0.0, -9.81)).unwrap()
}

/// The milling posture of section 4.
pub fn milling() -> Vec<f64> {
    let mut q = vec![0.0; 9];
    (q[3], q[6]) = (70f64.to_radians(), -100f64.to_radians());
    q
}

/// The model at the milling posture, watched and hit at the sensor along x, y, z.
pub fn system(mechanism: &Mechanism) -> LinearSystem {
    let (q, zero, mut tangent) = (milling(), vec![0.0; 9], Tangent::zeros(9));
    let ws = &mut Workspace::new(mechanism);
    let point = OperatingPoint { q: &q, qd: &zero, qdd: &zero, wrenches: &[] };
    linearize(mechanism, ws, &point, &mut tangent).unwrap();
    let jacobian = dynamics::jacobian(mechanism, ws, &q, 0, true).unwrap();
    let rows = jacobian.fixed_rows::<3>(0).transpose().as_slice().to_vec();
    let matrices =
        [tangent.mass, tangent.damping, tangent.stiffness].map(|m| m.transpose().as_slice().to_vec());
    LinearSystem::new(9, matrices, (0..9).map(Direction::Coordinate).collect(), rows.clone(), rows).unwrap()
}

/// The springs and dampers of the column "From [34]", all times `factor`.
pub fn springs(factor: f64) -> Vec<SpringDamper> {
    let pairs = STIFFNESS.into_iter().zip(DAMPING);
    pairs.map(|(k, d)| SpringDamper { stiffness: k * factor, damping: d * factor }).collect()
}
