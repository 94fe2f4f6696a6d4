//! Mass, tangent damping and tangent stiffness at an operating point, by analytic derivatives.
//!
//! f(q, q̇, q̈) = M q̈ + b + g − Jᵀ w; the tangents are C = ∂f/∂q̇ and K = ∂f/∂q (Huynh et al. 2021, Eqs. 14 to 17;
//! Do et al. 2022, Eq. 12 for the part of gravity and wrench). The derivatives of inverse dynamics follow Singh, Russell,
//! Wensing 2022 ("Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra"), in world axes.

use crate::Result;
use crate::dynamics::{FrameWrench, Workspace, composite_mass};
use crate::mechanism::{Mechanism, finite};
use crate::spatial::{Twist, angular, cross_twist, cross_wrench, linear, stack};
use nalgebra::{DMatrix, Matrix6, Vector3};

/// Where a mechanism is linearized.
#[derive(Debug, Clone, Copy)]
pub struct OperatingPoint<'a> {
    /// Coordinates, rad or m.
    pub q: &'a [f64],
    /// Velocities.
    pub qd: &'a [f64],
    /// Accelerations.
    pub qdd: &'a [f64],
    /// Wrenches, constant in world axes while their frames move.
    pub wrenches: &'a [FrameWrench],
}

/// The tangent matrices (n×n): f ≈ M δq̈ + C δq̇ + K δq.
#[derive(Debug, Clone, PartialEq)]
pub struct Tangent {
    /// M(q).
    pub mass: DMatrix<f64>,
    /// C = ∂f/∂q̇; the gyroscopic and Coriolis part only, joint dampers come with the impedances.
    pub damping: DMatrix<f64>,
    /// K = ∂f/∂q; gravity, wrench and motion, joint springs come with the impedances.
    pub stiffness: DMatrix<f64>,
}

impl Tangent {
    /// Zero matrices for n coordinates.
    pub fn zeros(n: usize) -> Self {
        let zero = DMatrix::zeros(n, n);
        Self { mass: zero.clone(), damping: zero.clone(), stiffness: zero }
    }
}

/// Fills `out` with M, C and K of the free mechanism at `point`.
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn linearize(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    point: &OperatingPoint<'_>,
    out: &mut Tangent,
) -> Result<()> {
    mechanism.check("q", point.q)?;
    mechanism.check("qd", point.qd)?;
    mechanism.check("qdd", point.qdd)?;
    ws.place(mechanism, point.q);
    ws.drive(mechanism, point.qd, point.qdd, mechanism.gravity());

    // Per coordinate: the rate of its axis, and the second rate that its parent's acceleration adds.
    let nodes = mechanism.nodes();
    let (rate, second): (Vec<Twist>, Vec<Twist>) = (0..mechanism.n())
        .map(|c| {
            let (v, a) = match nodes[mechanism.node_of(c)].parent {
                Some(parent) => (ws.twist[parent], ws.acceleration[parent]),
                None => (Twist::zeros(), stack(-mechanism.gravity(), Vector3::zeros())),
            };
            let rate = cross_twist(&v, &ws.axis[c]);
            (rate, cross_twist(&a, &ws.axis[c]) + cross_twist(&v, &rate))
        })
        .unzip();

    let mut coriolis: Vec<Matrix6<f64>> =
        (0..nodes.len()).map(|i| ws.inertia[i].twice_coriolis(&ws.twist[i])).collect();
    for i in (0..nodes.len()).rev() {
        if let Some(parent) = nodes[i].parent {
            let (matrix, force) = (coriolis[i], ws.force[i]);
            coriolis[parent] += matrix;
            ws.force[parent] += force;
        }
    }
    composite_mass(mechanism, ws, &mut out.mass);

    out.damping.fill(0.0);
    out.stiffness.fill(0.0);
    for c in 0..mechanism.n() {
        let i = mechanism.node_of(c);
        let (inertia, axis) = (&ws.inertia[i], &ws.axis[c]);
        // Rows of the wrench on the composite body projected on this axis, as functions of the earlier coordinate.
        let left_coriolis = coriolis[i].tr_mul(axis);
        let left_momentum = inertia.momentum(axis); // composite inertia is symmetric
        let by_velocity = coriolis[i] * axis + 2.0 * inertia.momentum(&rate[c]);
        let by_position =
            coriolis[i] * rate[c] + inertia.momentum(&second[c]) + cross_wrench(axis, &ws.force[i]);
        for &k in mechanism.support(Some(i)) {
            out.damping[(c, k)] = left_coriolis.dot(&ws.axis[k]) + 2.0 * left_momentum.dot(&rate[k]);
            out.stiffness[(c, k)] = left_coriolis.dot(&rate[k]) + left_momentum.dot(&second[k]);
            if k != c {
                out.damping[(k, c)] = ws.axis[k].dot(&by_velocity);
                out.stiffness[(k, c)] = ws.axis[k].dot(&by_position);
            }
        }
    }
    for wrench in point.wrenches {
        wrench_stiffness(mechanism, ws, wrench, |c, k, change| out.stiffness[(c, k)] -= change)?;
    }
    Ok(())
}

/// M and K of a robot at rest, by rows (n×n each): what [`linearize`] gives without velocity and acceleration, at a
/// fraction of its cost.
///
/// Gravity is conservative, so K_ck = p_c · (a_k × g) for k before c, with p_c the momentum of what axis c carries and a_k
/// the direction of axis k (Do et al. 2022, Eq. 12).
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn at_rest(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    wrenches: &[FrameWrench],
    mass: &mut [f64],
    stiffness: &mut [f64],
) -> Result<()> {
    mechanism.check("q", q)?;
    let n = mechanism.n();
    ws.place(mechanism, q);
    for (i, node) in mechanism.nodes().iter().enumerate() {
        ws.inertia[i] = node.inertia.moved(&ws.pose[i]);
    }
    mass.fill(0.0);
    stiffness.fill(0.0);
    for (i, node) in mechanism.nodes().iter().enumerate().rev() {
        if let Some(c) = mechanism.coordinate_of(i) {
            let momentum = ws.inertia[i].momentum(&ws.axis[c]);
            // Where momentum and gravity meet: p · (a × g) = a · (g × p).
            let heavy = mechanism.gravity().cross(&linear(&momentum));
            for &k in mechanism.support(Some(i)) {
                let (inertia, weight) = (ws.axis[k].dot(&momentum), angular(&ws.axis[k]).dot(&heavy));
                (mass[k * n + c], mass[c * n + k]) = (inertia, inertia);
                (stiffness[k * n + c], stiffness[c * n + k]) = (weight, weight);
            }
        }
        if let Some(parent) = node.parent {
            let child = ws.inertia[i];
            ws.inertia[parent].add(&child);
        }
    }
    for wrench in wrenches {
        wrench_stiffness(mechanism, ws, wrench, |c, k, change| stiffness[c * n + k] -= change)?;
    }
    Ok(())
}

/// Hands over ∂(Jᵀ w)_c/∂q_k for a wrench fixed in world axes (Do et al. 2022, Eq. 12).
///
/// The force's line of action moves with the frame and the moment arm with it; a force alone keeps K symmetric, a
/// moment does not (it is not conservative).
fn wrench_stiffness(
    mechanism: &Mechanism,
    ws: &Workspace,
    wrench: &FrameWrench,
    mut put: impl FnMut(usize, usize, f64),
) -> Result<()> {
    finite("wrench", wrench.force.iter().chain(wrench.moment.iter()).copied())?;
    let point = ws.frame_pose(mechanism, wrench.frame)?.translation;
    let about_origin = stack(wrench.force, wrench.moment + point.cross(&wrench.force));
    let support = mechanism.support(mechanism.frame(wrench.frame)?.node);
    for (position, &k) in support.iter().enumerate() {
        let shift = linear(&ws.axis[k]) + angular(&ws.axis[k]).cross(&point);
        let moment = shift.cross(&wrench.force);
        for (later, &c) in support.iter().enumerate() {
            let mut change = angular(&ws.axis[c]).dot(&moment);
            if later > position {
                change += cross_twist(&ws.axis[k], &ws.axis[c]).dot(&about_origin);
            }
            put(c, k, change);
        }
    }
    Ok(())
}
