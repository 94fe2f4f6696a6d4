//! Speed of the hot kernels on the KUKA KR90 model of Huynh et al. 2021: nine coordinates, 152 lines, 18 parameters.
//!
//! Run with `cargo bench -p armonic-core`; `RAYON_NUM_THREADS=1` keeps everything on one thread.

#[path = "../tests/problems/mod.rs"]
mod problems;

use armonic_core::dynamics::{self, Workspace};
use armonic_core::frf::responses;
use armonic_core::linearize::{OperatingPoint, Tangent, linearize};
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
    let (start, free) = (springs(0.8), (0..18).collect::<Vec<_>>());
    c.bench_function("residual and Jacobian to a triangle, 18 parameters", |b| {
        b.iter(|| problem.reduce(black_box(&start), &free).unwrap());
    });
    c.bench_function("cost alone", |b| {
        b.iter(|| problem.reduce(black_box(&start), &[]).unwrap());
    });
}

criterion_group!(benches, kernels);
criterion_main!(benches);
