//! Modes followed through systems, against the eigenvalues of the explicit state matrix and each other.

mod problems;

use armonic_core::Error;
use armonic_core::dynamics::{FrameWrench, Workspace};
use armonic_core::impedance::{Drive, DriveNumbers};
use armonic_core::linearize::{OperatingPoint, Tangent, at_rest, linearize};
use armonic_core::modes::{Modes, Walk, follow};
use nalgebra::{Complex, DMatrix, Vector3};
use problems::{DAMPING, STIFFNESS, kuka, milling};

type C64 = Complex<f64>;
const N: usize = 9;
const DRIVEN: [usize; 3] = [0, 3, 6];

/// PID on the first, motor and link PD on the second, PD on the third motor.
fn numbers() -> [DriveNumbers; 3] {
    let base = DriveNumbers {
        scale: 1.0,
        shaft: 5.0e6,
        inertia: 60.0,
        damping: 4.0e3,
        stiffness: 5.0e6 + 2.0e6,
        integral: 3.0e6,
        link: [0.0; 3],
    };
    let second = DriveNumbers { integral: 0.0, link: [2.0e5, 50.0, 0.0], scale: 2.0, shaft: 2.0e6, ..base };
    [base, second, DriveNumbers { integral: 0.0, inertia: 25.0, ..base }]
}

fn drives() -> Vec<(usize, Drive)> {
    DRIVEN.into_iter().zip(numbers()).map(|(i, numbers)| (i, Drive::new(&numbers).unwrap())).collect()
}

/// M, C and K of the KUKA along a straight line of postures, springs on what is not driven, and the shafts.
fn line(count: usize) -> [Vec<f64>; 3] {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let mut damping = vec![0.0; N * N];
    (0..N).for_each(|i| damping[i * N + i] = DAMPING[i]);
    let (mut mass, mut stiffness) = (vec![0.0; count * N * N], vec![0.0; count * N * N]);
    for (case, (mass, stiffness)) in
        mass.chunks_exact_mut(N * N).zip(stiffness.chunks_exact_mut(N * N)).enumerate()
    {
        let mut q = milling();
        q[3] -= 0.6 * case as f64 / (count - 1) as f64;
        q[6] += 0.9 * case as f64 / (count - 1) as f64;
        at_rest(&robot, ws, &q, &[], mass, stiffness).unwrap();
        (0..N).filter(|i| !DRIVEN.contains(i)).for_each(|i| stiffness[i * N + i] += STIFFNESS[i]);
        for (i, drive) in DRIVEN.into_iter().zip(numbers()) {
            stiffness[i * N + i] += drive.scale.powi(2) * drive.shaft;
        }
    }
    [mass, damping, stiffness]
}

/// Eigenvalues of ẋ = A x with x = [q, q_m, q̇, q̇_m, ∫q_m of the first motor], from the equations of motion.
fn explicit_poles(mass: &[f64], damping: &[f64], stiffness: &[f64]) -> Vec<C64> {
    let z = N + 3;
    let [mut m, mut c, mut k] = [(); 3].map(|()| DMatrix::zeros(z, z));
    for (whole, part) in [(&mut m, mass), (&mut c, damping), (&mut k, stiffness)] {
        whole.view_mut((0, 0), (N, N)).copy_from(&DMatrix::from_row_slice(N, N, part));
    }
    for (d, (i, numbers)) in DRIVEN.into_iter().zip(numbers()).enumerate() {
        let (motor, wk) = (N + d, numbers.scale * numbers.shaft);
        (m[(motor, motor)], c[(motor, motor)], k[(motor, motor)]) =
            (numbers.inertia, numbers.damping, numbers.stiffness);
        (k[(i, motor)], k[(motor, i)], c[(motor, i)]) = (-wk, numbers.link[0] - wk, numbers.link[1]);
    }
    let inverse = m.try_inverse().unwrap();
    let mut a = DMatrix::zeros(2 * z + 1, 2 * z + 1);
    a.view_mut((0, z), (z, z)).fill_with_identity();
    a.view_mut((z, 0), (z, z)).copy_from(&-(&inverse * k));
    a.view_mut((z, z), (z, z)).copy_from(&-(&inverse * c));
    a[(z + N, 2 * z)] = -numbers()[0].integral / numbers()[0].inertia;
    a[(2 * z, N)] = 1.0;
    a.complex_eigenvalues().iter().copied().collect()
}

/// One of each pair and the real ones, from slow to fast.
fn above(poles: &[C64]) -> Vec<C64> {
    let mut kept: Vec<_> = poles.iter().copied().filter(|pole| pole.im >= 0.0).collect();
    kept.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    kept
}

/// Shapes by columns of n: what Z(λ) of the first system all but annihilates.
fn shapes(walk: &Walk<'_>, poles: &[C64]) -> Vec<C64> {
    let one = |&s: &C64| {
        let entry = |i: usize| s * s * walk.mass[i] + s * walk.damping[i] + walk.stiffness[i];
        let mut z = DMatrix::from_fn(N, N, |i, j| entry(i * N + j));
        for ((i, drive), numbers) in walk.drives[0].iter().zip(numbers()) {
            z[(*i, *i)] -= drive.turn(s) * (numbers.scale * numbers.shaft);
        }
        // Inverse iteration twice, from all ones; real for a real pole.
        let mut u = DMatrix::from_element(N, 1, C64::new(1.0, 0.0));
        let solver = (z + DMatrix::identity(N, N) * C64::new(1e-9, 0.0)).lu();
        for _ in 0..2 {
            u = solver.solve(&u).unwrap();
            u /= C64::new(u.norm(), 0.0);
        }
        u.iter().copied().collect::<Vec<_>>()
    };
    poles.iter().flat_map(one).collect()
}

fn walk<'a>(matrices: &'a [Vec<f64>; 3], drives: &'a [Vec<(usize, Drive)>], springs: &'a [f64]) -> Walk<'a> {
    let [mass, damping, stiffness] = matrices;
    Walk { n: N, mass, damping, stiffness, drives, springs }
}

fn followed(matrices: &[Vec<f64>; 3]) -> Modes {
    let (drives, springs) = ([drives()], springs());
    let walk = walk(matrices, &drives, &springs);
    let [mass, damping, stiffness] = matrices;
    let start = above(&explicit_poles(&mass[..N * N], damping, &stiffness[..N * N]));
    follow(&walk, &start, &shapes(&walk, &start)).unwrap()
}

fn springs() -> Vec<f64> {
    (0..N).map(|i| if DRIVEN.contains(&i) { 0.0 } else { STIFFNESS[i] }).collect()
}

#[test]
fn every_followed_pole_is_one_of_the_explicit_state_matrix_and_none_is_missing() {
    let count = 60;
    let matrices = line(count);
    let found = followed(&matrices);
    assert_eq!(found.reached, count);
    let m = found.poles.len() / count;
    for (case, poles) in found.poles.chunks_exact(m).enumerate() {
        let part = |matrix: &'_ [f64]| matrix[case * N * N..][..N * N].to_vec();
        let expected = above(&explicit_poles(&part(&matrices[0]), &matrices[1], &part(&matrices[2])));
        assert_eq!(expected.len(), m);
        for pole in expected {
            // Schur's algorithm is backward stable at the size of the fastest pole.
            let nearest = poles.iter().map(|p| (p - pole).norm() / pole.norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-8, "case {case}: {pole} is missed by {nearest:e}");
        }
    }
    assert!(found.residuals.iter().all(|&residual| residual <= 1.0));
}

#[test]
fn one_long_step_and_many_short_ones_lead_to_the_same_modes_in_the_same_order() {
    let fine = line(400);
    let coarse = [&fine[0], &fine[1], &fine[2]].map(|matrix| {
        let ends = |matrix: &[f64]| [&matrix[..N * N], &matrix[matrix.len() - N * N..]].concat();
        if matrix.len() > N * N { ends(matrix) } else { matrix.clone() }
    });
    let (fine, coarse) = (followed(&fine), followed(&coarse));
    assert_eq!((fine.reached, coarse.reached), (400, 2));
    let m = coarse.poles.len() / 2;
    for (a, b) in fine.poles[399 * m..].iter().zip(&coarse.poles[m..]) {
        assert!((a - b).norm() < 1e-10 * a.norm());
    }
}

#[test]
fn shapes_have_unit_norm_in_the_mass_matrix_with_motors_and_shares_add_up_to_one() {
    let matrices = line(5);
    let found = followed(&matrices);
    let (m, width) = (found.poles.len() / 5, N + 3);
    let mass = DMatrix::from_row_slice(N, N, &matrices[0][4 * N * N..]);
    for (mode, u) in found.shapes[4 * m * width..].chunks_exact(width).enumerate() {
        let (links, motors) = u.split_at(N);
        let mut size = 0.0;
        for i in 0..N {
            for j in 0..N {
                size += (links[i].conj() * links[j]).re * mass[(i, j)];
            }
        }
        for ((motor, numbers), &i) in motors.iter().zip(numbers()).zip(&DRIVEN) {
            size += numbers.inertia * motor.norm_sqr();
            let turn = Drive::new(&numbers).unwrap().turn(found.poles[4 * m + mode]);
            assert!((motor - turn * links[i]).norm() < 1e-10 * (1.0 + motor.norm()));
        }
        assert!((size - 1.0).abs() < 1e-12);
        let shares: f32 = found.shares[(4 * m + mode) * N..][..N].iter().sum();
        assert!((shares - 1.0).abs() < 1e-6); // single precision
    }
}

#[test]
fn a_set_with_a_pole_missing_or_twice_is_not_accepted() {
    let matrices = line(2);
    let (drives, springs) = ([drives()], springs());
    let walk = walk(&matrices, &drives, &springs);
    let start = above(&explicit_poles(&matrices[0][..N * N], &matrices[1], &matrices[2][..N * N]));
    let less = &start[1..];
    assert_eq!(follow(&walk, less, &shapes(&walk, less)).unwrap().reached, 0);
    let mut twice = start.clone();
    twice[4] = twice[5];
    assert_eq!(follow(&walk, &twice, &shapes(&walk, &twice)).unwrap().reached, 0);
}

#[test]
fn a_robot_at_rest_has_the_matrices_of_the_general_linearization() {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let force = Vector3::new(300.0, -200.0, 500.0);
    let load = [FrameWrench { frame: 0, force, moment: Vector3::new(40.0, 30.0, -60.0) }];
    let q: Vec<_> = milling().iter().enumerate().map(|(i, q)| q + 0.1 * (i as f64).sin()).collect();
    let (zero, mut tangent) = (vec![0.0; N], Tangent::zeros(N));
    let point = OperatingPoint { q: &q, qd: &zero, qdd: &zero, wrenches: &load };
    linearize(&robot, ws, &point, &mut tangent).unwrap();
    let (mut mass, mut stiffness) = (vec![0.0; N * N], vec![0.0; N * N]);
    at_rest(&robot, ws, &q, &load, &mut mass, &mut stiffness).unwrap();
    for (fast, full) in [(mass, &tangent.mass), (stiffness, &tangent.stiffness)] {
        let difference = DMatrix::from_row_slice(N, N, &fast) - full;
        assert!(difference.amax() < 1e-12 * full.amax());
    }
}

#[test]
fn a_drive_without_inertia_is_refused() {
    let refused = Drive::new(&DriveNumbers { inertia: 0.0, ..numbers()[2] });
    assert!(matches!(refused, Err(Error::Value { what: "inertia of a drive", got: 0.0, .. })));
}
