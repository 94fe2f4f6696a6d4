//! The grinding robot Scompi of Do, Vu, Liu 2022 (Tables 1 to 4), and a walk through its workspace.

use armonic_core::dynamics::Workspace;
use armonic_core::impedance::{Drive, DriveNumbers};
use armonic_core::linearize::at_rest;
use armonic_core::mechanism::{Mechanism, Motion, Node};
use armonic_core::spatial::{Inertia, Transform, rotation};
use nalgebra::{Complex, DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Coordinates.
pub const N: usize = 6;
/// θ (of the track's line), d, a, α.
const DH: [[f64; 4]; N] = [
    [FRAC_PI_2, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.192, FRAC_PI_2],
    [0.0, 0.0, 0.420, 0.0],
    [0.0, 0.0, 0.0, FRAC_PI_2],
    [0.0, 0.380, 0.0, FRAC_PI_2],
    [0.0, 0.088, 0.0, -FRAC_PI_2],
];
const MASS: [f64; N] = [19.0, 5.723, 5.166, 4.425, 3.302, 1.022];
const COM: [[f64; 3]; N] = [
    [0.021, 0.031, -0.226],
    [-0.054, 0.003, 0.014],
    [-0.138, 0.0, -0.019],
    [0.011, 0.012, 0.161],
    [0.0, -0.026, -0.022],
    [-0.004, 0.039, 0.0],
];
/// xx, yy, zz, xy, xz, yz.
const TENSOR: [[f64; 6]; N] = [
    [0.0; 6],
    [0.010, 0.044, 0.043, 0.003, -0.003, 0.0],
    [0.008, 0.160, 0.160, 0.0, -0.010, 0.0],
    [0.044, 0.044, 0.008, 0.0, 0.002, 0.007],
    [0.012, 0.006, 0.008, 0.0, 0.0, -0.001],
    [0.001, 0.001, 0.012, 0.0, 0.0, 0.0],
];
/// Gear ratio, rotor inertia, shaft stiffness, motor damping, joint damping.
const DRIVES: [[f64; 5]; N] = [
    [51.0, 1.71e-4, 25.0e3, 9.46e-4, 2.73],
    [160.0, 2.65e-4, 120.0e3, 9.46e-4, 24.74],
    [160.0, 2.42e-4, 120.0e3, 9.46e-4, 5.76],
    [160.0, 1.26e-4, 57.0e3, 9.46e-4, 9.37],
    [160.0, 0.91e-4, 29.0e3, 5.90e-4, 8.74],
    [160.0, 0.86e-4, 29.0e3, 5.90e-4, 8.74],
];
const RADIUS: f64 = 0.057;
const GAINS: [f64; 2] = [15e3, 52.0];

/// The six joints; gravity along −x0.
pub fn scompi() -> Mechanism {
    let turned = |m: Matrix3<f64>| Transform { rotation: m, translation: Vector3::zeros() };
    let mut before = turned(Matrix3::identity());
    let mut nodes: Vec<Node> = Vec::new();
    for (link, [theta, d, a, alpha]) in DH.into_iter().enumerate() {
        let along = Transform {
            rotation: rotation(&Vector3::z_axis(), theta),
            translation: Vector3::new(0.0, 0.0, d),
        };
        let after = Transform {
            rotation: rotation(&Vector3::x_axis(), alpha),
            translation: Vector3::new(a, 0.0, 0.0),
        };
        let [xx, yy, zz, xy, xz, yz] = TENSOR[link];
        let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let turn = after.rotation;
        let axis = Vector3::z_axis();
        nodes.push(Node {
            parent: link.checked_sub(1),
            placement: before.then(&along),
            motion: if link == 0 { Motion::Prismatic(axis) } else { Motion::Revolute(axis) },
            inertia: Inertia::about_com(
                MASS[link],
                turn * Vector3::from(COM[link]) + after.translation,
                turn * tensor * turn.transpose(),
            ),
        });
        before = after;
    }
    Mechanism::new(nodes, vec![], Vector3::new(-9.81, 0.0, 0.0)).unwrap()
}

/// The motors behind their shafts, under proportional-derivative control.
fn numbers() -> [DriveNumbers; N] {
    let mut link = 0;
    DRIVES.map(|[gear, rotor, shaft, damper, _]| {
        link += 1;
        DriveNumbers {
            scale: if link == 1 { 1.0 / RADIUS } else { 1.0 },
            shaft,
            inertia: gear * gear * rotor,
            damping: damper + GAINS[1],
            stiffness: shaft + GAINS[0],
            integral: 0.0,
            link: [0.0; 3],
        }
    })
}

/// What the motors add to the dynamic stiffness, by coordinate.
pub fn drives() -> Vec<(usize, Drive)> {
    numbers().iter().map(|numbers| Drive::new(numbers).unwrap()).enumerate().collect()
}

/// A motion from the first posture of the paper's path, by `change` (rad or m) a step.
pub fn motion(count: usize, change: [f64; N]) -> Vec<[f64; N]> {
    let start: [f64; N] = [0.0, -30.0, 120.0, -10.0, -120.0, 0.0].map(f64::to_radians);
    (0..count).map(|step| std::array::from_fn(|i| start[i] + change[i] * step as f64)).collect()
}

/// M and K with the shafts, row by row, along a motion, and C.
pub fn systems(robot: &Mechanism, motion: &[[f64; N]]) -> [Vec<f64>; 3] {
    let (mut mass, mut stiffness) = (Vec::new(), Vec::new());
    let mut damping = vec![0.0; N * N];
    (0..N).for_each(|i| damping[i * N + i] = DRIVES[i][4]);
    let ws = &mut Workspace::new(robot);
    for q in motion {
        let (mut m, mut k) = (vec![0.0; N * N], vec![0.0; N * N]);
        at_rest(robot, ws, q, &[], &mut m, &mut k).unwrap();
        for (i, numbers) in numbers().iter().enumerate() {
            k[i * N + i] += numbers.scale.powi(2) * numbers.shaft;
        }
        mass.extend(m);
        stiffness.extend(k);
    }
    [mass, damping, stiffness]
}

/// Poles above the real axis (rad/s) of the first of some systems and their shapes on the coordinates, N entries each.
pub fn modes([mass, damping, stiffness]: &[Vec<f64>; 3]) -> (Vec<Complex<f64>>, Vec<Complex<f64>>) {
    let [mass, damping, stiffness] =
        [mass, damping, stiffness].map(|rows| DMatrix::from_row_slice(N, N, &rows[..N * N]));
    // Accelerations of coordinates and motors by position, then by velocity; B q̈_m = w k q − (k + K_P) q_m − (D_m + K_D) q̇_m.
    let mut forces = DMatrix::zeros(2 * N, 4 * N);
    let inverse = mass.clone().try_inverse().unwrap();
    forces.view_mut((0, 0), (N, N)).copy_from(&-(&inverse * &stiffness));
    forces.view_mut((0, 2 * N), (N, N)).copy_from(&-(&inverse * &damping));
    let mut pull = DMatrix::zeros(N, N);
    for (i, numbers) in numbers().into_iter().enumerate() {
        let wk = numbers.scale * numbers.shaft;
        pull[(i, i)] = wk;
        forces[(N + i, i)] = wk / numbers.inertia;
        forces[(N + i, N + i)] = -numbers.stiffness / numbers.inertia;
        forces[(N + i, 3 * N + i)] = -numbers.damping / numbers.inertia;
    }
    forces.view_mut((0, N), (N, N)).copy_from(&(&inverse * pull));
    let mut state = DMatrix::zeros(4 * N, 4 * N);
    state.view_mut((0, 2 * N), (2 * N, 2 * N)).fill_with_identity();
    state.view_mut((2 * N, 0), (2 * N, 4 * N)).copy_from(&forces);
    let poles: Vec<_> = state.complex_eigenvalues().iter().copied().filter(|pole| pole.im > 0.0).collect();
    let shape = |&pole: &Complex<f64>| {
        let s = pole * (1.0 + 1e-8);
        let mut z =
            DMatrix::from_fn(N, N, |i, j| s * s * mass[(i, j)] + s * damping[(i, j)] + stiffness[(i, j)]);
        for (i, numbers) in numbers().into_iter().enumerate() {
            let motor = s * s * numbers.inertia + s * numbers.damping + numbers.stiffness;
            z[(i, i)] -= (numbers.scale * numbers.shaft).powi(2) / motor;
        }
        let shape = z.lu().solve(&DVector::from_element(N, Complex::new(1.0, 0.0))).unwrap().normalize();
        shape.as_slice().to_vec()
    };
    let shapes = poles.iter().flat_map(shape).collect();
    (poles, shapes)
}
