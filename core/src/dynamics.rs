//! Poses, Jacobians, mass matrix, bias and gravity forces, inverse and forward dynamics.
//!
//! Equation of motion: M(q) q̈ + b(q, q̇) + g(q) = τ + Jᵀ w, with b the Coriolis, centrifugal and gyroscopic forces
//! (Huynh et al. 2021, Eqs. 7 to 11; Do et al. 2022, Eq. 1). Recursions as in Featherstone 2008, in world axes.

use crate::mechanism::{Mechanism, Motion, finite};
use crate::spatial::{
    Inertia, Transform, Twist, Wrench, angular, cross_twist, cross_wrench, linear, rotation, stack,
};
use crate::{Error, Result};
use nalgebra::{Cholesky, DMatrix, DVector, Matrix6xX, Vector3};

/// A coordinate that moves less than this share of its own inertia once the others are free moves no mass.
const PIVOT_FLOOR: f64 = 1e-13;

/// A wrench that the surroundings exert at a frame's origin, constant in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameWrench {
    /// Index of the frame it acts at.
    pub frame: usize,
    /// Force in world axes, N.
    pub force: Vector3<f64>,
    /// Moment in world axes, N m.
    pub moment: Vector3<f64>,
}

/// Scratch memory for one mechanism; every algorithm fills what it needs, so one workspace serves a whole batch.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// T_world_node.
    pub pose: Vec<Transform>,
    /// Axis of each coordinate as a unit twist.
    pub axis: Vec<Twist>,
    pub(crate) twist: Vec<Twist>,
    pub(crate) acceleration: Vec<Twist>,
    pub(crate) inertia: Vec<Inertia>,
    pub(crate) force: Vec<Wrench>,
}

impl Workspace {
    /// Memory for `mechanism`.
    pub fn new(mechanism: &Mechanism) -> Self {
        let nodes = mechanism.nodes().len();
        Self {
            pose: vec![Transform::identity(); nodes],
            axis: vec![Twist::zeros(); mechanism.n()],
            twist: vec![Twist::zeros(); nodes],
            acceleration: vec![Twist::zeros(); nodes],
            inertia: vec![Inertia::zero(); nodes],
            force: vec![Wrench::zeros(); nodes],
        }
    }

    /// Poses of all nodes and axes of all coordinates at q.
    pub(crate) fn place(&mut self, mechanism: &Mechanism, q: &[f64]) {
        for (i, node) in mechanism.nodes().iter().enumerate() {
            let mut pose = match node.parent {
                Some(parent) => self.pose[parent].then(&node.placement),
                None => node.placement,
            };
            if let Some(c) = mechanism.coordinate_of(i) {
                match &node.motion {
                    Motion::Revolute(axis) => {
                        let direction = pose.rotation * axis.into_inner();
                        self.axis[c] = stack(pose.translation.cross(&direction), direction);
                        pose.rotation *= rotation(axis, q[c]);
                    }
                    Motion::Prismatic(axis) => {
                        let direction = pose.rotation * axis.into_inner();
                        self.axis[c] = stack(direction, Vector3::zeros());
                        pose.translation += direction * q[c];
                    }
                    Motion::Fixed => unreachable!("a fixed node has no coordinate"),
                }
            }
            self.pose[i] = pose;
        }
    }

    /// Twists, accelerations (gravity included as that of the base) and inertias of all nodes, after [`Self::place`].
    pub(crate) fn drive(&mut self, mechanism: &Mechanism, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>) {
        let base = stack(-gravity, Vector3::zeros());
        for (i, node) in mechanism.nodes().iter().enumerate() {
            let (mut v, mut a) = match node.parent {
                Some(parent) => (self.twist[parent], self.acceleration[parent]),
                None => (Twist::zeros(), base),
            };
            if let Some(c) = mechanism.coordinate_of(i) {
                let axis = &self.axis[c];
                a += axis * qdd[c] + cross_twist(&v, axis) * qd[c];
                v += axis * qd[c];
            }
            self.twist[i] = v;
            self.acceleration[i] = a;
            self.inertia[i] = node.inertia.moved(&self.pose[i]);
            self.force[i] = self.inertia[i].momentum(&a) + cross_wrench(&v, &self.inertia[i].momentum(&v));
        }
    }

    /// Pose of a frame, after [`Self::place`].
    pub(crate) fn frame_pose(&self, mechanism: &Mechanism, index: usize) -> Result<Transform> {
        let frame = mechanism.frame(index)?;
        Ok(match frame.node {
            Some(node) => self.pose[node].then(&frame.placement),
            None => frame.placement,
        })
    }
}

/// T_world_frame at q.
///
/// # Errors
/// Wrong length or number in `q`, unknown frame.
pub fn pose(mechanism: &Mechanism, ws: &mut Workspace, q: &[f64], frame: usize) -> Result<Transform> {
    mechanism.check("q", q)?;
    ws.place(mechanism, q);
    ws.frame_pose(mechanism, frame)
}

/// Jacobian (6×n) of a frame: velocity of its origin over its angular velocity (Huynh et al. 2021, Eq. 5).
///
/// `own_axes` turns the rows into the frame's own axes; otherwise they stand in world axes.
///
/// # Errors
/// Wrong length or number in `q`, unknown frame.
pub fn jacobian(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    frame: usize,
    own_axes: bool,
) -> Result<Matrix6xX<f64>> {
    let at = pose(mechanism, ws, q, frame)?;
    let mut out = Matrix6xX::zeros(mechanism.n());
    for &c in mechanism.support(mechanism.frame(frame)?.node) {
        let (v, w) = (linear(&ws.axis[c]), angular(&ws.axis[c]));
        let column =
            if own_axes { at.twist_from_world(&ws.axis[c]) } else { stack(v + w.cross(&at.translation), w) };
        out.set_column(c, &column);
    }
    Ok(out)
}

/// Velocity and acceleration of a frame's origin over its angular ones, in world axes (Do et al. 2022, Eqs. A.4, A.7).
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn frame_motion(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    [q, qd, qdd]: [&[f64]; 3],
    frame: usize,
) -> Result<[Twist; 2]> {
    let at = pose(mechanism, ws, q, frame)?.translation;
    mechanism.check("qd", qd)?;
    mechanism.check("qdd", qdd)?;
    ws.drive(mechanism, qd, qdd, &Vector3::zeros());
    let Some(node) = mechanism.frame(frame)?.node else {
        return Ok([Twist::zeros(); 2]);
    };
    let (v, a) = (&ws.twist[node], &ws.acceleration[node]);
    let velocity = linear(v) + angular(v).cross(&at);
    let acceleration = linear(a) + angular(a).cross(&at) + angular(v).cross(&velocity);
    Ok([stack(velocity, angular(v)), stack(acceleration, angular(a))])
}

/// Mass matrix (n×n) at q by the composite rigid body algorithm (Featherstone 2008, chapter 6).
///
/// # Errors
/// Wrong length or number in `q`.
pub fn mass_matrix(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    out: &mut DMatrix<f64>,
) -> Result<()> {
    mechanism.check("q", q)?;
    ws.place(mechanism, q);
    for (i, node) in mechanism.nodes().iter().enumerate() {
        ws.inertia[i] = node.inertia.moved(&ws.pose[i]);
    }
    composite_mass(mechanism, ws, out);
    Ok(())
}

/// Sums inertias towards the base and projects them on the axes; leaves the composite inertias in the workspace.
pub(crate) fn composite_mass(mechanism: &Mechanism, ws: &mut Workspace, out: &mut DMatrix<f64>) {
    out.fill(0.0);
    for (i, node) in mechanism.nodes().iter().enumerate().rev() {
        if let Some(c) = mechanism.coordinate_of(i) {
            let momentum = ws.inertia[i].momentum(&ws.axis[c]);
            for &k in mechanism.support(Some(i)) {
                let entry = ws.axis[k].dot(&momentum);
                out[(k, c)] = entry;
                out[(c, k)] = entry;
            }
        }
        if let Some(parent) = node.parent {
            let child = ws.inertia[i];
            ws.inertia[parent].add(&child);
        }
    }
}

/// Joint forces τ = M q̈ + b(q, q̇) + g(q) − Σ Jᵀ w by the recursive Newton-Euler algorithm.
///
/// `gravity` and `qdd` may be zeroed by the caller to single out b or g; see [`bias`] and [`gravity_torque`].
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn inverse_dynamics(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    qdd: &[f64],
    wrenches: &[FrameWrench],
) -> Result<DVector<f64>> {
    newton_euler(mechanism, ws, [q, qd, qdd], mechanism.gravity(), wrenches)
}

/// Coriolis, centrifugal and gyroscopic forces b(q, q̇), gravity left out (Huynh et al. 2021, Eq. 9).
///
/// # Errors
/// Wrong length or number in an argument.
pub fn bias(mechanism: &Mechanism, ws: &mut Workspace, q: &[f64], qd: &[f64]) -> Result<DVector<f64>> {
    let zero = vec![0.0; mechanism.n()];
    newton_euler(mechanism, ws, [q, qd, &zero], &Vector3::zeros(), &[])
}

/// Joint forces g(q) that hold the robot still under gravity.
///
/// # Errors
/// Wrong length or number in `q`.
pub fn gravity_torque(mechanism: &Mechanism, ws: &mut Workspace, q: &[f64]) -> Result<DVector<f64>> {
    let zero = vec![0.0; mechanism.n()];
    newton_euler(mechanism, ws, [q, &zero, &zero], mechanism.gravity(), &[])
}

fn newton_euler(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    [q, qd, qdd]: [&[f64]; 3],
    gravity: &Vector3<f64>,
    wrenches: &[FrameWrench],
) -> Result<DVector<f64>> {
    mechanism.check("q", q)?;
    mechanism.check("qd", qd)?;
    mechanism.check("qdd", qdd)?;
    ws.place(mechanism, q);
    ws.drive(mechanism, qd, qdd, gravity);
    for wrench in wrenches {
        finite("wrench", wrench.force.iter().chain(wrench.moment.iter()).copied())?;
        let at = ws.frame_pose(mechanism, wrench.frame)?;
        if let Some(node) = mechanism.frame(wrench.frame)?.node {
            ws.force[node] -= stack(wrench.force, wrench.moment + at.translation.cross(&wrench.force));
        }
    }
    let mut tau = DVector::zeros(mechanism.n());
    for (i, node) in mechanism.nodes().iter().enumerate().rev() {
        if let Some(c) = mechanism.coordinate_of(i) {
            tau[c] = ws.axis[c].dot(&ws.force[i]);
        }
        if let Some(parent) = node.parent {
            let child = ws.force[i];
            ws.force[parent] += child;
        }
    }
    Ok(tau)
}

/// Accelerations q̈ = M⁻¹ (τ + Σ Jᵀ w − b − g).
///
/// # Errors
/// Wrong length or number in an argument, unknown frame, [`Error::MassNotPositiveDefinite`].
pub fn forward_dynamics(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    tau: &[f64],
    wrenches: &[FrameWrench],
) -> Result<DVector<f64>> {
    mechanism.check("tau", tau)?;
    let zero = vec![0.0; mechanism.n()];
    let rest = inverse_dynamics(mechanism, ws, q, qd, &zero, wrenches)?;
    let mut mass = DMatrix::zeros(mechanism.n(), mechanism.n());
    composite_mass(mechanism, ws, &mut mass);
    let diagonal = mass.diagonal();
    let factor = Cholesky::new(mass).ok_or(Error::MassNotPositiveDefinite)?;
    // Rounding can leave a singular matrix a last pivot just above zero.
    if (0..mechanism.n()).any(|i| factor.l_dirty()[(i, i)].powi(2) <= PIVOT_FLOOR * diagonal[i]) {
        return Err(Error::MassNotPositiveDefinite);
    }
    Ok(factor.solve(&(DVector::from_column_slice(tau) - rest)))
}
