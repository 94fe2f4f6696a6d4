//! Identities of the core that need nothing from outside: algorithms against each other and against plain dense algebra.

mod problems;

use armonic_core::bushing::{self, Bushing};
use armonic_core::dynamics::{self, FrameWrench, Workspace};
use armonic_core::frf::responses;
use armonic_core::impedance::{Direction, SpringDamper};
use armonic_core::linearize::{OperatingPoint, Tangent, linearize};
use armonic_core::residual::{Problem, Target};
use armonic_core::system::LinearSystem;
use armonic_core::{Error, spatial::Transform};
use nalgebra::{Complex, DMatrix, DVector, Matrix6, Vector3};
use problems::{kuka, milling, springs, system};
use std::f64::consts::TAU;

type C64 = Complex<f64>;

fn lines(count: usize) -> Vec<C64> {
    (1..=count).map(|i| C64::new(0.0, TAU * 0.2 * i as f64)).collect()
}

/// Numbers without pattern, the same in every run.
fn scattered(count: usize, seed: f64) -> Vec<f64> {
    (0..count).map(|i| (12.9898 * (i as f64 + 1.0) + 78.233 * seed).sin() * 0.7).collect()
}

fn moving() -> [Vec<f64>; 3] {
    let q = milling().iter().zip(scattered(9, 1.0)).map(|(a, b)| a + b).collect();
    [q, scattered(9, 2.0), scattered(9, 3.0)]
}

const LOAD: FrameWrench = FrameWrench {
    frame: 0,
    force: Vector3::new(300.0, -200.0, 500.0),
    moment: Vector3::new(40.0, 30.0, -60.0),
};

#[test]
fn columns_of_the_mass_matrix_are_inverse_dynamics_of_unit_accelerations() {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let ([q, ..], zero) = (moving(), vec![0.0; 9]);
    let mut mass = DMatrix::zeros(9, 9);
    dynamics::mass_matrix(&robot, ws, &q, &mut mass).unwrap();
    let still = dynamics::gravity_torque(&robot, ws, &q).unwrap();
    for i in 0..9 {
        let mut unit = zero.clone();
        unit[i] = 1.0;
        let column = dynamics::inverse_dynamics(&robot, ws, &q, &zero, &unit, &[]).unwrap() - &still;
        assert!((column - mass.column(i)).amax() < 1e-12 * mass.amax());
    }
}

#[test]
fn forward_dynamics_undoes_inverse_dynamics() {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let [q, qd, qdd] = moving();
    let tau = dynamics::inverse_dynamics(&robot, ws, &q, &qd, &qdd, &[LOAD]).unwrap();
    let back = dynamics::forward_dynamics(&robot, ws, &q, &qd, tau.as_slice(), &[LOAD]).unwrap();
    assert!((back - DVector::from_vec(qdd)).amax() < 1e-11);
}

/// Central differences of a vector function, error of order step² and rounding/step: about 1e-9 of the values.
fn differences(at: &[f64], mut f: impl FnMut(&[f64]) -> DVector<f64>) -> DMatrix<f64> {
    let step = 1e-5;
    let columns: Vec<_> = (0..at.len())
        .map(|i| {
            let (mut up, mut down) = (at.to_vec(), at.to_vec());
            up[i] += step;
            down[i] -= step;
            (f(&up) - f(&down)) / (2.0 * step)
        })
        .collect();
    DMatrix::from_columns(&columns)
}

#[test]
fn tangents_are_the_derivatives_of_inverse_dynamics_under_a_wrench() {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let [q, qd, qdd] = moving();
    let mut tangent = Tangent::zeros(9);
    let wrenches = &[LOAD];
    linearize(&robot, ws, &OperatingPoint { q: &q, qd: &qd, qdd: &qdd, wrenches }, &mut tangent).unwrap();
    let by_q = differences(&q, |q| dynamics::inverse_dynamics(&robot, ws, q, &qd, &qdd, wrenches).unwrap());
    let by_qd =
        differences(&qd, |qd| dynamics::inverse_dynamics(&robot, ws, &q, qd, &qdd, wrenches).unwrap());
    assert!((&tangent.stiffness - &by_q).amax() < 1e-7 * by_q.amax());
    assert!((&tangent.damping - &by_qd).amax() < 1e-7 * by_qd.amax());
}

#[test]
fn a_bushing_between_frames_of_one_link_resists_nothing() {
    let robot = kuka();
    let ws = &mut Workspace::new(&robot);
    let [q, qd, _] = moving();
    let symmetric = |seed| {
        let a = Matrix6::from_column_slice(&scattered(36, seed));
        a * a.transpose() * 1e5
    };
    let rest = Transform::identity();
    let held = Bushing { frame_a: 0, frame_b: 0, stiffness: symmetric(4.0), damping: symmetric(5.0), rest };
    assert!(bushing::force(&robot, ws, &q, &qd, &held).unwrap().amax() < 1e-6);
}

/// H by dense LU, one line at a time.
fn dense_response(
    z: [&[f64]; 3],
    springs: &[(Vec<f64>, SpringDamper)],
    out: &[f64],
    inp: &[f64],
    s: C64,
) -> DMatrix<C64> {
    let n = inp.len() / (inp.len() / z[0].len().isqrt());
    let [m, c, k] = z.map(|a| DMatrix::from_row_slice(n, n, a).map(|v| C64::new(v, 0.0)));
    let mut z = m * (s * s) + c * s + k;
    for (b, spring) in springs {
        let b = DVector::from_column_slice(b).map(|v| C64::new(v, 0.0));
        z += &b * b.transpose() * (s * spring.damping + spring.stiffness);
    }
    let rows = |a: &[f64]| DMatrix::from_row_slice(a.len() / n, n, a).map(|v| C64::new(v, 0.0));
    rows(out) * z.lu().solve(&rows(inp).transpose()).unwrap()
}

#[test]
fn responses_equal_dense_algebra_for_every_size_symmetry_and_tail() {
    for n in 1..=10 {
        for (symmetric, count) in [(true, 1), (true, 17), (false, 9)] {
            let square = |seed: f64, diagonal: f64| {
                let a = DMatrix::from_column_slice(n, n, &scattered(n * n, seed));
                let skew = if symmetric { 0.0 } else { 0.3 };
                let a =
                    (&a + a.transpose()) + DMatrix::identity(n, n) * diagonal + (&a - a.transpose()) * skew;
                a.transpose().as_slice().to_vec()
            };
            let (mass, damping, stiffness) = (square(1.0, 10.0), square(2.0, 30.0), square(3.0, 4000.0));
            let (out, inp) = (scattered(2 * n, 4.0), scattered(4 * n, 5.0));
            let dense = scattered(n, 6.0);
            let mut unit = vec![0.0; n];
            unit[n - 1] = 1.0;
            let springs = [
                SpringDamper { stiffness: 900.0, damping: 7.0 },
                SpringDamper { stiffness: 2000.0, damping: 3.0 },
            ];
            let directions = vec![Direction::Coordinate(n - 1), Direction::Dense(dense.clone())];
            let matrices = [mass.clone(), damping.clone(), stiffness.clone()];
            let system = LinearSystem::new(n, matrices, directions, out.clone(), inp.clone()).unwrap();
            let s = lines(count);
            let got = responses(&[&system], &[springs.to_vec()], &s, false).unwrap().values;
            for (line, &s) in s.iter().enumerate() {
                let branches = [(unit.clone(), springs[0]), (dense.clone(), springs[1])];
                let want = dense_response([&mass, &damping, &stiffness], &branches, &out, &inp, s);
                for a in 0..2 {
                    for b in 0..4 {
                        let difference = (got[(a * 4 + b) * count + line] - want[(a, b)]).norm();
                        assert!(difference < 1e-12 * want.camax(), "n {n}, line {line}: {difference}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_vanishing_pivot_is_solved_with_row_exchanges_and_a_resonance_is_refused() {
    // Z₀₀ = k − ω²m = 0 at ω = 10 without damping; the whole Z is regular there.
    let (mass, stiffness) = (vec![1.0, 0.0, 0.0, 1.0], vec![100.0, 50.0, 50.0, 300.0]);
    let both = vec![1.0, 0.0, 0.0, 1.0];
    let system = |stiffness: Vec<f64>| {
        LinearSystem::new(2, [mass.clone(), vec![0.0; 4], stiffness], vec![], both.clone(), both.clone())
            .unwrap()
    };
    let s = [C64::new(0.0, 10.0), C64::new(0.0, 11.0)];
    let got = responses(&[&system(stiffness.clone())], &[vec![]], &s, false).unwrap().values;
    for (line, s) in s.into_iter().enumerate() {
        let want = dense_response([&mass, &[0.0; 4], &stiffness], &[], &both, &both, s);
        assert!((got[line] - want[(0, 0)]).norm() < 1e-14);
        assert!((got[2 + line] - want[(0, 1)]).norm() < 1e-14);
    }
    let error = responses(&[&system(vec![100.0, 0.0, 0.0, 300.0])], &[vec![]], &s, false).unwrap_err();
    assert_eq!(error, Error::Singular { line: 0, hz: 10.0 / TAU });
}

#[test]
fn the_triangle_is_that_of_all_rows_at_once() {
    let (robot, s) = (kuka(), lines(150));
    let model = system(&robot);
    let measured = responses(&[&model], &[springs(1.0)], &s, false).unwrap().values;
    let start = springs(0.6);
    let at = responses(&[&model], std::slice::from_ref(&start), &s, true).unwrap();
    let weights: Vec<f64> = scattered(measured.len(), 7.0).iter().map(|w| w.abs()).collect();
    let free = [0, 3, 8, 9, 17];
    let target = Target::new(model, &s, &measured, &weights, &weights).unwrap();
    let triangle = Problem::new(vec![target]).unwrap().reduce(&start, &free.map(|i| vec![i])).unwrap();

    let mut rows = DMatrix::zeros(2 * measured.len(), free.len() + 1);
    for (i, &weight) in weights.iter().enumerate() {
        let root = weight.sqrt();
        let ratio = at.values[i] / measured[i];
        let value = |parameter: usize| {
            let spring = start[parameter % 9];
            let size = if parameter < 9 { spring.stiffness } else { spring.damping };
            at.sensitivities[parameter * measured.len() + i] / at.values[i] * size
        };
        for (column, &parameter) in free.iter().enumerate() {
            rows[(2 * i, column)] = root * value(parameter).re;
            rows[(2 * i + 1, column)] = root * value(parameter).im;
        }
        rows[(2 * i, free.len())] = root * ratio.norm().ln();
        rows[(2 * i + 1, free.len())] = root * ratio.arg();
    }
    let want = rows.tr_mul(&rows);
    let r = DMatrix::from_row_slice(triangle.width, triangle.width, &triangle.values);
    assert!((r.tr_mul(&r) - &want).amax() < 1e-12 * want.amax());
    assert!((triangle.cost() - want[(free.len(), free.len())]).abs() < 1e-12 * triangle.cost());
    assert!((triangle.price - triangle.cost()).abs() < 1e-12 * triangle.cost());
}
