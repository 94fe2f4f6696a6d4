//! The vector that a small complex matrix shortens most: inverse iteration on AᴴA with a factor of complete pivoting.

use nalgebra::Complex as C64;

/// Steps of inverse iteration; each shortens the error by (σ_m/σ_(m−1))².
const STEPS: usize = 2;

/// Memory for m×m matrices.
pub(crate) struct NullVector {
    m: usize,
    /// L below the diagonal, U on and above it, of A with its rows and columns in another order.
    lu: Vec<C64<f64>>,
    /// Where each column of the factor stands in A.
    columns: Vec<usize>,
    x: Vec<C64<f64>>,
}

impl NullVector {
    pub(crate) fn new(m: usize) -> Self {
        let zero = C64::new(0.0, 0.0);
        Self { m, lu: vec![zero; m * m], columns: vec![0; m], x: vec![zero; m] }
    }

    /// Sets `v` (m) to the right singular vector of the smallest singular value of `a` (m×m, by rows), of length one,
    /// its largest entry real and positive; ‖A v‖.
    pub(crate) fn find(&mut self, a: impl Iterator<Item = C64<f64>> + Clone, v: &mut [C64<f64>]) -> f64 {
        self.lu.iter_mut().zip(a.clone()).for_each(|(place, entry)| *place = entry);
        self.factor();
        self.x.fill(C64::new(0.0, 0.0));
        self.x[self.m - 1] = C64::new(1.0, 0.0);
        self.upper();
        normalize(&mut self.x);
        for _ in 0..STEPS {
            // The order of the rows drops out of AᴴA.
            self.upper_adjoint();
            normalize(&mut self.x); // a second step without it could overflow
            self.lower_adjoint();
            self.lower();
            self.upper();
            normalize(&mut self.x);
        }
        for (&column, &entry) in self.columns.iter().zip(&self.x) {
            v[column] = entry;
        }
        normalize(v);
        let mut a = a;
        let mut sum = 0.0;
        for _ in 0..self.m {
            sum += v.iter().zip(&mut a).map(|(v, a)| a * v).sum::<C64<f64>>().norm_sqr();
        }
        sum.sqrt()
    }

    fn factor(&mut self) {
        let (m, lu) = (self.m, &mut self.lu);
        self.columns.iter_mut().enumerate().for_each(|(i, column)| *column = i);
        let mut floor = 0.0;
        for j in 0..m {
            let (mut best, mut place) = (-1.0, (j, j));
            for i in j..m {
                for c in j..m {
                    let size = lu[i * m + c].norm_sqr();
                    if size > best {
                        (best, place) = (size, (i, c));
                    }
                }
            }
            for c in 0..m {
                lu.swap(j * m + c, place.0 * m + c);
            }
            for i in 0..m {
                lu.swap(i * m + j, i * m + place.1);
            }
            self.columns.swap(j, place.1);
            if j == 0 {
                floor = if best > 0.0 { f64::EPSILON * best.sqrt() } else { 1.0 };
            }
            if lu[j * m + j].norm() < floor {
                lu[j * m + j] = C64::new(floor, 0.0); // within rounding of what stood there
            }
            let inverse = lu[j * m + j].inv();
            for i in j + 1..m {
                let l = lu[i * m + j] * inverse;
                lu[i * m + j] = l;
                for c in j + 1..m {
                    let known = lu[j * m + c];
                    lu[i * m + c] -= l * known;
                }
            }
        }
    }

    fn upper(&mut self) {
        let (m, lu, x) = (self.m, &self.lu, &mut self.x);
        for i in (0..m).rev() {
            for c in i + 1..m {
                let known = x[c];
                x[i] -= lu[i * m + c] * known;
            }
            x[i] /= lu[i * m + i];
        }
    }

    fn upper_adjoint(&mut self) {
        let (m, lu, x) = (self.m, &self.lu, &mut self.x);
        for i in 0..m {
            x[i] /= lu[i * m + i].conj();
            for c in i + 1..m {
                let known = x[i];
                x[c] -= lu[i * m + c].conj() * known;
            }
        }
    }

    fn lower(&mut self) {
        let (m, lu, x) = (self.m, &self.lu, &mut self.x);
        for i in 0..m {
            for c in 0..i {
                let known = x[c];
                x[i] -= lu[i * m + c] * known;
            }
        }
    }

    fn lower_adjoint(&mut self) {
        let (m, lu, x) = (self.m, &self.lu, &mut self.x);
        for i in (0..m).rev() {
            for c in 0..i {
                let known = x[i];
                x[c] -= lu[i * m + c].conj() * known;
            }
        }
    }
}

/// Brings a vector to length one, its largest entry real and positive.
pub(crate) fn normalize(x: &mut [C64<f64>]) {
    let Some(largest) = x.iter().copied().reduce(|a, b| if b.l1_norm() > a.l1_norm() { b } else { a }) else {
        return;
    };
    x.iter_mut().for_each(|z| *z /= largest.l1_norm()); // no square of it overflows
    let largest = x.iter().copied().reduce(|a, b| if b.norm_sqr() > a.norm_sqr() { b } else { a });
    let largest = largest.unwrap_or(C64::new(1.0, 0.0));
    let length = x.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt();
    let turn = largest.conj() / (largest.norm() * length);
    x.iter_mut().for_each(|z| *z *= turn);
}
