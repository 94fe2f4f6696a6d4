//! The mechanism and its algorithms, over one posture or a batch of them.

use crate::convert::{array, homogeneous, numbers, raise, transform, vector};
use armonic_core::bushing;
use armonic_core::dynamics::{self, FrameWrench, Workspace};
use armonic_core::linearize::{OperatingPoint, Tangent, at_rest, linearize};
use armonic_core::mechanism::{self, Frame, Motion, Node};
use armonic_core::spatial::Inertia;
use nalgebra::{DMatrix, Matrix3, Matrix6, Unit, Vector3};
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type Out<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;
/// A wrench as Python passes it: frame index and force over moment in world axes.
type WrenchArgument = (FrameIndex, [f64; 6]);

/// A frame's index; a negative number is an error of value, like one past the end.
#[derive(Clone, Copy)]
struct FrameIndex(usize);

impl FromPyObject<'_, '_> for FrameIndex {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        let index: i64 = object.extract()?;
        let refused = || PyValueError::new_err(format!("frame: found index {index}, expected zero or more"));
        usize::try_from(index).map(Self).map_err(|_| refused())
    }
}

/// Tree of rigid nodes, immutable.
#[pyclass(frozen, module = "armonic._core")]
pub struct Mechanism {
    pub(crate) inner: mechanism::Mechanism,
}

/// Spring and damper between two frames, immutable.
#[pyclass(frozen, module = "armonic._core")]
pub struct Bushing {
    pub(crate) inner: bushing::Bushing,
}

fn wrenches(arguments: Option<Vec<WrenchArgument>>) -> Vec<FrameWrench> {
    let one = |(frame, w): WrenchArgument| FrameWrench {
        frame: frame.0,
        force: Vector3::new(w[0], w[1], w[2]),
        moment: Vector3::new(w[3], w[4], w[5]),
    };
    arguments.into_iter().flatten().map(one).collect()
}

fn copy_rows(matrix: &DMatrix<f64>, out: &mut [f64]) {
    let n = matrix.nrows();
    for i in 0..n {
        for j in 0..n {
            out[i * n + j] = matrix[(i, j)];
        }
    }
}

impl Mechanism {
    /// One argument of shape (n,) or (P, n): its numbers, and P where there is one.
    fn rows(&self, name: &str, values: &Array<'_>) -> PyResult<(Vec<f64>, Option<usize>)> {
        let n = Some(self.inner.n());
        match values.ndim() {
            1 => Ok((numbers(name, values, &[n])?, None)),
            _ => Ok((numbers(name, values, &[None, n])?, Some(values.shape()[0]))),
        }
    }

    /// Several arguments that share one leading shape.
    fn states<const A: usize>(
        &self,
        given: [(&str, &Array<'_>); A],
    ) -> PyResult<([Vec<f64>; A], Option<usize>)> {
        let mut batch = None;
        let mut out = std::array::from_fn(|_| Vec::new());
        for (index, (name, values)) in given.into_iter().enumerate() {
            let (rows, count) = self.rows(name, values)?;
            if index > 0 && count != batch {
                return Err(PyValueError::new_err(format!(
                    "{name}: expected the same shape as {}",
                    given[0].0
                )));
            }
            (out[index], batch) = (rows, count);
        }
        Ok((out, batch))
    }

    /// Runs `one` for every posture, in parallel where there are several, each writing its share of the result.
    fn each<'py, F>(&self, py: Python<'py>, batch: Option<usize>, tail: &[usize], one: F) -> Out<'py>
    where
        F: Fn(&mut Workspace, usize, &mut [f64]) -> armonic_core::Result<()> + Sync,
    {
        let size: usize = tail.iter().product();
        let count = batch.unwrap_or(1);
        let mut out = vec![0.0; count * size];
        py.detach(|| {
            if count == 1 || size == 0 {
                let ws = &mut Workspace::new(&self.inner);
                return (0..count.min(1)).try_for_each(|_| one(ws, 0, &mut out));
            }
            out.par_chunks_mut(size)
                .enumerate()
                .try_for_each_init(|| Workspace::new(&self.inner), |ws, (case, out)| one(ws, case, out))
        })
        .map_err(raise)?;
        let shape: Vec<usize> = batch.into_iter().chain(tail.iter().copied()).collect();
        array(py, out, &shape)
    }

    fn slice<'a>(&self, rows: &'a [f64], case: usize) -> &'a [f64] {
        &rows[case * self.inner.n()..(case + 1) * self.inner.n()]
    }
}

#[pymethods]
impl Mechanism {
    #[new]
    #[pyo3(signature = (*, parents, placements, kinds, axes, masses, coms, inertias, frame_nodes, frame_placements, gravity))]
    #[allow(clippy::too_many_arguments)] // the table of nodes, column by column
    fn new(
        parents: Vec<i64>,
        placements: Array<'_>,
        kinds: Vec<String>,
        axes: Array<'_>,
        masses: Array<'_>,
        coms: Array<'_>,
        inertias: Array<'_>,
        frame_nodes: Vec<i64>,
        frame_placements: Array<'_>,
        gravity: [f64; 3],
    ) -> PyResult<Self> {
        let (count, frames) = (Some(parents.len()), Some(frame_nodes.len()));
        let placements = numbers("placements", &placements, &[count, Some(4), Some(4)])?;
        let axes = numbers("axes", &axes, &[count, Some(3)])?;
        let masses = numbers("masses", &masses, &[count])?;
        let coms = numbers("coms", &coms, &[count, Some(3)])?;
        let inertias = numbers("inertias", &inertias, &[count, Some(3), Some(3)])?;
        let frame_placements = numbers("frame_placements", &frame_placements, &[frames, Some(4), Some(4)])?;
        for (name, values) in [("masses", &masses), ("coms", &coms), ("inertias", &inertias)] {
            if let Some(got) = values.iter().find(|v| !v.is_finite()) {
                return Err(PyValueError::new_err(format!("{name}: found {got}, expected finite numbers")));
            }
        }
        if kinds.len() != parents.len() {
            return Err(PyValueError::new_err("kinds: expected one per node"));
        }
        let index = |name: &str, i: i64| match i {
            -1 => Ok(None),
            _ => usize::try_from(i).map(Some).map_err(|_| {
                PyValueError::new_err(format!(
                    "{name}: found {i}, expected -1 for the base or a node's index"
                ))
            }),
        };
        let nodes = (0..parents.len())
            .map(|i| {
                let axis = Vector3::from_column_slice(&axes[3 * i..3 * i + 3]);
                let axis = || {
                    let unit = Unit::try_new(axis, 1e-12).filter(|unit| unit.iter().all(|v| v.is_finite()));
                    unit.ok_or_else(|| {
                        PyValueError::new_err(format!("axes: node {i} has no finite direction"))
                    })
                };
                Ok(Node {
                    parent: index("parents", parents[i])?,
                    placement: transform("placements", &placements[16 * i..16 * i + 16])?,
                    motion: match kinds[i].as_str() {
                        "fixed" => Motion::Fixed,
                        "revolute" => Motion::Revolute(axis()?),
                        "prismatic" => Motion::Prismatic(axis()?),
                        other => {
                            return Err(PyValueError::new_err(format!(
                                "kinds: found {other:?}, expected \"fixed\", \"revolute\" or \"prismatic\""
                            )));
                        }
                    },
                    inertia: Inertia::about_com(
                        masses[i],
                        Vector3::from_column_slice(&coms[3 * i..3 * i + 3]),
                        Matrix3::from_row_slice(&inertias[9 * i..9 * i + 9]),
                    ),
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let frames = frame_nodes
            .iter()
            .enumerate()
            .map(|(i, &node)| {
                let placement = transform("frame_placements", &frame_placements[16 * i..16 * i + 16])?;
                Ok(Frame { node: index("frame_nodes", node)?, placement })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let inner = mechanism::Mechanism::new(nodes, frames, Vector3::from(gravity)).map_err(raise)?;
        Ok(Self { inner })
    }

    /// Number of coordinates.
    #[getter]
    fn n(&self) -> usize {
        self.inner.n()
    }

    /// T_world_frame, (4, 4) or (P, 4, 4).
    fn pose<'py>(&self, py: Python<'py>, q: Array<'py>, frame: FrameIndex) -> Out<'py> {
        let ([q], batch) = self.states([("q", &q)])?;
        self.each(py, batch, &[4, 4], |ws, case, out| {
            homogeneous(&dynamics::pose(&self.inner, ws, self.slice(&q, case), frame.0)?, out);
            Ok(())
        })
    }

    /// Jacobian of a frame, linear rows over angular ones, (6, n) or (P, 6, n).
    #[pyo3(signature = (q, frame, *, own_axes = false))]
    fn jacobian<'py>(&self, py: Python<'py>, q: Array<'py>, frame: FrameIndex, own_axes: bool) -> Out<'py> {
        let ([q], batch) = self.states([("q", &q)])?;
        let n = self.inner.n();
        self.each(py, batch, &[6, n], |ws, case, out| {
            let matrix = dynamics::jacobian(&self.inner, ws, self.slice(&q, case), frame.0, own_axes)?;
            for i in 0..6 {
                for j in 0..n {
                    out[i * n + j] = matrix[(i, j)];
                }
            }
            Ok(())
        })
    }

    /// Velocity and acceleration of a frame's origin, linear over angular, in world axes: (2, 6) or (P, 2, 6).
    fn frame_motion<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        qd: Array<'py>,
        qdd: Array<'py>,
        frame: FrameIndex,
    ) -> Out<'py> {
        let ([q, qd, qdd], batch) = self.states([("q", &q), ("qd", &qd), ("qdd", &qdd)])?;
        self.each(py, batch, &[2, 6], |ws, case, out| {
            let state = [&q, &qd, &qdd].map(|rows| self.slice(rows, case));
            let motion = dynamics::frame_motion(&self.inner, ws, state, frame.0)?;
            out[..6].copy_from_slice(motion[0].as_slice());
            out[6..].copy_from_slice(motion[1].as_slice());
            Ok(())
        })
    }

    /// M(q), (n, n) or (P, n, n).
    fn mass_matrix<'py>(&self, py: Python<'py>, q: Array<'py>) -> Out<'py> {
        let ([q], batch) = self.states([("q", &q)])?;
        let n = self.inner.n();
        self.each(py, batch, &[n, n], |ws, case, out| {
            let mut mass = DMatrix::zeros(n, n);
            dynamics::mass_matrix(&self.inner, ws, self.slice(&q, case), &mut mass)?;
            copy_rows(&mass, out);
            Ok(())
        })
    }

    /// Joint forces that hold the robot still under gravity, (n,) or (P, n).
    fn gravity_torque<'py>(&self, py: Python<'py>, q: Array<'py>) -> Out<'py> {
        let ([q], batch) = self.states([("q", &q)])?;
        self.each(py, batch, &[self.inner.n()], |ws, case, out| {
            let tau = dynamics::gravity_torque(&self.inner, ws, self.slice(&q, case))?;
            out.copy_from_slice(tau.as_slice());
            Ok(())
        })
    }

    /// Coriolis, centrifugal and gyroscopic forces, (n,) or (P, n).
    fn bias<'py>(&self, py: Python<'py>, q: Array<'py>, qd: Array<'py>) -> Out<'py> {
        let ([q, qd], batch) = self.states([("q", &q), ("qd", &qd)])?;
        self.each(py, batch, &[self.inner.n()], |ws, case, out| {
            let tau = dynamics::bias(&self.inner, ws, self.slice(&q, case), self.slice(&qd, case))?;
            out.copy_from_slice(tau.as_slice());
            Ok(())
        })
    }

    /// Joint forces for a motion, (n,) or (P, n).
    #[pyo3(signature = (q, qd, qdd, *, wrenches = None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        qd: Array<'py>,
        qdd: Array<'py>,
        wrenches: Option<Vec<WrenchArgument>>,
    ) -> Out<'py> {
        let ([q, qd, qdd], batch) = self.states([("q", &q), ("qd", &qd), ("qdd", &qdd)])?;
        let wrenches = self::wrenches(wrenches);
        self.each(py, batch, &[self.inner.n()], |ws, case, out| {
            let [q, qd, qdd] = [&q, &qd, &qdd].map(|rows| self.slice(rows, case));
            let tau = dynamics::inverse_dynamics(&self.inner, ws, q, qd, qdd, &wrenches)?;
            out.copy_from_slice(tau.as_slice());
            Ok(())
        })
    }

    /// Accelerations under joint forces, (n,) or (P, n).
    #[pyo3(signature = (q, qd, tau, *, wrenches = None))]
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        qd: Array<'py>,
        tau: Array<'py>,
        wrenches: Option<Vec<WrenchArgument>>,
    ) -> Out<'py> {
        let ([q, qd, tau], batch) = self.states([("q", &q), ("qd", &qd), ("tau", &tau)])?;
        let wrenches = self::wrenches(wrenches);
        self.each(py, batch, &[self.inner.n()], |ws, case, out| {
            let [q, qd, tau] = [&q, &qd, &tau].map(|rows| self.slice(rows, case));
            let qdd = dynamics::forward_dynamics(&self.inner, ws, q, qd, tau, &wrenches)?;
            out.copy_from_slice(qdd.as_slice());
            Ok(())
        })
    }

    /// Mass and tangent stiffness at rest, each (P, n, n), on the calling thread.
    #[pyo3(signature = (q, *, wrenches = None))]
    fn at_rest<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        wrenches: Option<Vec<WrenchArgument>>,
    ) -> PyResult<[Bound<'py, PyArrayDyn<f64>>; 2]> {
        let n = self.inner.n();
        let rows = numbers("q", &q, &[None, Some(n)])?;
        let wrenches = self::wrenches(wrenches);
        let count = q.shape()[0];
        let (mut mass, mut stiffness) = (vec![0.0; count * n * n], vec![0.0; count * n * n]);
        py.detach(|| {
            let ws = &mut Workspace::new(&self.inner);
            let matrices =
                mass.chunks_exact_mut((n * n).max(1)).zip(stiffness.chunks_exact_mut((n * n).max(1)));
            matrices.enumerate().try_for_each(|(case, (mass, stiffness))| {
                at_rest(&self.inner, ws, self.slice(&rows, case), &wrenches, mass, stiffness)
            })
        })
        .map_err(raise)?;
        let shape = [count, n, n];
        Ok([array(py, mass, &shape)?, array(py, stiffness, &shape)?])
    }

    /// Mass, tangent damping and tangent stiffness stacked: (3, n, n) or (P, 3, n, n).
    #[pyo3(signature = (q, qd, qdd, *, wrenches = None, bushings = None))]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        qd: Array<'py>,
        qdd: Array<'py>,
        wrenches: Option<Vec<WrenchArgument>>,
        bushings: Option<Vec<PyRef<'py, Bushing>>>,
    ) -> Out<'py> {
        let ([q, qd, qdd], batch) = self.states([("q", &q), ("qd", &qd), ("qdd", &qdd)])?;
        let wrenches = self::wrenches(wrenches);
        let bushings: Vec<_> = bushings.iter().flatten().map(|b| b.inner.clone()).collect();
        let n = self.inner.n();
        self.each(py, batch, &[3, n, n], |ws, case, out| {
            let [q, qd, qdd] = [&q, &qd, &qdd].map(|rows| self.slice(rows, case));
            let mut tangent = Tangent::zeros(n);
            linearize(&self.inner, ws, &OperatingPoint { q, qd, qdd, wrenches: &wrenches }, &mut tangent)?;
            for bushing in &bushings {
                bushing::add_tangent(&self.inner, ws, q, qd, bushing, &mut tangent)?;
            }
            for (matrix, out) in [&tangent.mass, &tangent.damping, &tangent.stiffness]
                .into_iter()
                .zip(out.chunks_exact_mut(n * n))
            {
                copy_rows(matrix, out);
            }
            Ok(())
        })
    }
}

#[pymethods]
impl Bushing {
    /// Unloaded where `rest` puts the robot.
    #[new]
    #[pyo3(signature = (mechanism, frame_a, frame_b, *, stiffness, damping, rest))]
    fn new(
        mechanism: &Mechanism,
        frame_a: FrameIndex,
        frame_b: FrameIndex,
        stiffness: Array<'_>,
        damping: Array<'_>,
        rest: Array<'_>,
    ) -> PyResult<Self> {
        let matrix = |name: &str, values: &Array<'_>| -> PyResult<Matrix6<f64>> {
            let values = numbers(name, values, &[Some(6), Some(6)])?;
            if values.iter().any(|v| !v.is_finite()) {
                return Err(PyValueError::new_err(format!("{name}: expected finite numbers")));
            }
            Ok(Matrix6::from_row_slice(&values))
        };
        let (stiffness, damping) = (matrix("stiffness", &stiffness)?, matrix("damping", &damping)?);
        let rest = numbers("rest", &rest, &[Some(mechanism.inner.n())])?;
        if let Some(got) = rest.iter().find(|v| !v.is_finite()) {
            return Err(PyValueError::new_err(format!("rest: found {got}, expected finite numbers")));
        }
        let ws = &mut Workspace::new(&mechanism.inner);
        let rest =
            bushing::relative_pose(&mechanism.inner, ws, &rest, frame_a.0, frame_b.0).map_err(raise)?;
        Ok(Self {
            inner: bushing::Bushing { frame_a: frame_a.0, frame_b: frame_b.0, stiffness, damping, rest },
        })
    }

    /// Directions in coordinate space along which its six springs act, (6, n).
    fn directions<'py>(&self, py: Python<'py>, mechanism: &Mechanism, q: Array<'py>) -> Out<'py> {
        let q = numbers("q", &q, &[Some(mechanism.inner.n())])?;
        let ws = &mut Workspace::new(&mechanism.inner);
        let rows = bushing::directions(&mechanism.inner, ws, &q, &self.inner).map_err(raise)?;
        array(py, rows.transpose().as_slice().to_vec(), &[6, mechanism.inner.n()])
    }

    /// Joint forces that it resists with, (n,), on the left-hand side of the equation of motion.
    fn force<'py>(&self, py: Python<'py>, mechanism: &Mechanism, q: Array<'py>, qd: Array<'py>) -> Out<'py> {
        let q = numbers("q", &q, &[Some(mechanism.inner.n())])?;
        let qd = numbers("qd", &qd, &[Some(mechanism.inner.n())])?;
        let ws = &mut Workspace::new(&mechanism.inner);
        let tau = bushing::force(&mechanism.inner, ws, &q, &qd, &self.inner).map_err(raise)?;
        Ok(vector(py, tau.as_slice()))
    }
}
