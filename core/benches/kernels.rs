//! Speed of the hot kernels: on the KUKA KR90 model of Huynh et al. 2021 with nine coordinates, 152 lines, 18
//! parameters, of following the twelve modes of the robot Scompi of Do et al. 2022, and of the poles of autoregressions
//! of six channels.
//!
//! Run with `cargo bench -p armonic-core`; `RAYON_NUM_THREADS=1` keeps everything on one thread.

#[path = "../tests/problems/mod.rs"]
mod problems;
mod scompi;

use armonic_core::dynamics::{self, Workspace};
use armonic_core::frf::responses;
use armonic_core::linearize::{OperatingPoint, Tangent, at_rest, linearize};
use armonic_core::matrix_polynomial::eigenvalues;
use armonic_core::modes::{Walk, follow};
use armonic_core::residual::{Problem, Target};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Complex;
use problems::{kuka, milling, springs, system};
use std::f64::consts::TAU;
use std::hint::black_box;

fn kernels(c: &mut Criterion) {
    let mechanism = kuka();
    let q = milling();
    let zero = vec![0.0; 9];
    let mut ws = Workspace::new(&mechanism);
    let mut tangent = Tangent::zeros(9);
    c.bench_function("mass matrix", |b| {
        b.iter(|| dynamics::mass_matrix(&mechanism, &mut ws, black_box(&q), &mut tangent.mass));
    });
    c.bench_function("linearize", |b| {
        let point = OperatingPoint { q: &q, qd: &zero, qdd: &zero, wrenches: &[] };
        b.iter(|| linearize(&mechanism, &mut ws, black_box(&point), &mut tangent));
    });

    let model = system(&mechanism);
    let systems = [&model];
    let lines: Vec<_> = (1..=152).map(|i| Complex::new(0.0, TAU * 0.2 * f64::from(i))).collect();
    let truth = [springs(1.0)];
    c.bench_function("FRF, 152 lines", |b| {
        b.iter(|| responses(&systems, &truth, black_box(&lines), false).unwrap());
    });
    c.bench_function("FRF with 18 sensitivities, 152 lines", |b| {
        b.iter(|| responses(&systems, &truth, black_box(&lines), true).unwrap());
    });
    let measured = responses(&systems, &truth, &lines, false).unwrap().values;
    let target =
        Target::new(model.clone(), &lines, &measured, &vec![1.0; 9 * 152], &vec![1.0; 9 * 152]).unwrap();
    let problem = Problem::new(vec![target]).unwrap();
    let (start, free) = (springs(0.8), (0..18).map(|i| vec![i]).collect::<Vec<_>>());
    c.bench_function("residual and Jacobian to a triangle, 18 parameters", |b| {
        b.iter(|| problem.reduce(black_box(&start), &free).unwrap());
    });
    c.bench_function("cost alone", |b| {
        b.iter(|| problem.reduce(black_box(&start), &[]).unwrap());
    });
}

fn survey(c: &mut Criterion) {
    const POSTURES: usize = 512;
    let robot = scompi::scompi();
    // A robot's own motion at a thousand postures a second, and a line of a grid.
    let motions = [("path", [2e-4; scompi::N]), ("grid", [0.0, 0.0, 0.0, 1.5e-2, 0.0, 0.0])]
        .map(|(name, change)| (name, scompi::motion(POSTURES, change)));
    let mut ws = Workspace::new(&robot);
    let (mut mass, mut stiffness) = ([0.0; 36], [0.0; 36]);
    c.bench_function("mass and stiffness at rest", |b| {
        let q = &motions[0].1[0];
        b.iter(|| at_rest(&robot, &mut ws, black_box(q), &[], &mut mass, &mut stiffness));
    });
    for (name, motion) in &motions {
        let systems = scompi::systems(&robot, motion);
        let (poles, shapes) = scompi::modes(&systems);
        let [mass, damping, stiffness] = &systems;
        let drives = [scompi::drives()];
        let walk = Walk { n: scompi::N, mass, damping, stiffness, drives: &drives, springs: &[] };
        assert_eq!(follow(&walk, &poles, &shapes).unwrap().reached, POSTURES);
        c.bench_function(&format!("twelve modes through 512 postures of a {name}"), |b| {
            b.iter(|| follow(black_box(&walk), &poles, &shapes).unwrap());
        });
    }
}

fn poles(c: &mut Criterion) {
    const CHANNELS: usize = 6;
    // Coefficients that wander and fade, alike from order to order.
    let entry = |i: usize| (1.7 * (i * i) as f64).sin() / (1.0 + (i / 36) as f64);
    let longest: Vec<_> = (0..100 * CHANNELS * CHANNELS).map(entry).collect();
    let orders: Vec<_> = (2..=100).map(|p| &longest[..p * CHANNELS * CHANNELS]).collect();
    assert!(eigenvalues(CHANNELS, &orders).unwrap().iter().all(|order| order.converged));
    c.bench_function("poles of six channels, orders 2 to 100", |b| {
        b.iter(|| eigenvalues(CHANNELS, black_box(&orders)).unwrap());
    });
}

criterion_group!(benches, kernels, survey, poles);
criterion_main!(benches);
