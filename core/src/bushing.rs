//! Springs and dampers between any two frames: a 6×6 bushing with action and reaction.
//!
//! The deformation e of frame b seen from frame a stacks the shift of b's origin over twice the vector part of the
//! quaternion of its turn (the rotation vector for small turns), both in a's axes and against the rest pose. The force
//! is K e + D ė; it acts on the coordinates through E = ∂e/∂q, so what b feels a feels back (Huynh et al. 2021,
//! Eqs. 12 and 13, for any direction at once).

use crate::Result;
use crate::dynamics::Workspace;
use crate::linearize::Tangent;
use crate::mechanism::Mechanism;
use crate::spatial::{Transform, Twist, angular, cross_twist, linear, quaternion, skew, stack};
use nalgebra::{DVector, Matrix3, Matrix6, Matrix6xX, Vector3, Vector6};

/// A linear spring and damper between two frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Bushing {
    /// Frame whose axes it lives in.
    pub frame_a: usize,
    /// Frame it holds.
    pub frame_b: usize,
    /// N/m, N/rad, N m/m, N m/rad; symmetric.
    pub stiffness: Matrix6<f64>,
    /// The same per second; symmetric.
    pub damping: Matrix6<f64>,
    /// T_a_b where it is unloaded.
    pub rest: Transform,
}

/// Deformation of a bushing and how the coordinates change it, at one posture.
struct Deformation {
    shape: Vector6<f64>,
    shift: Vector3<f64>,
    turn: (f64, Vector3<f64>),
    /// Relative axis of every coordinate in a's axes about a's origin, zero where both ends move alike.
    axis: Matrix6xX<f64>,
    /// E = ∂e/∂q.
    jacobian: Matrix6xX<f64>,
    a: Transform,
}

/// T_a_b at q: the `rest` of a bushing that is unloaded there.
///
/// # Errors
/// Wrong length or number in `q`, unknown frame.
pub fn relative_pose(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    frame_a: usize,
    frame_b: usize,
) -> Result<Transform> {
    mechanism.check("q", q)?;
    ws.place(mechanism, q);
    let a = ws.frame_pose(mechanism, frame_a)?;
    let b = ws.frame_pose(mechanism, frame_b)?;
    let inverse = a.rotation.transpose();
    Ok(Transform { rotation: inverse * b.rotation, translation: inverse * (b.translation - a.translation) })
}

/// E = ∂e/∂q (6×n): each row is the direction in coordinate space along which one spring of the bushing acts.
///
/// # Errors
/// Wrong length or number in `q`, unknown frame.
pub fn directions(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    bushing: &Bushing,
) -> Result<Matrix6xX<f64>> {
    Ok(deformation(mechanism, ws, q, bushing)?.jacobian)
}

/// Resisting joint forces Eᵀ (K e + D E q̇), on the left-hand side of the equation of motion.
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn force(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    bushing: &Bushing,
) -> Result<DVector<f64>> {
    force_and_loss(mechanism, ws, q, qd, bushing).map(|(force, _)| force)
}

/// The forces of [`force`], and the power ėᵀ D ė that the dampers take, W.
///
/// # Errors
/// As [`force`].
pub fn force_and_loss(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    bushing: &Bushing,
) -> Result<(DVector<f64>, f64)> {
    mechanism.check("qd", qd)?;
    let at = deformation(mechanism, ws, q, bushing)?;
    let rate = &at.jacobian * DVector::from_column_slice(qd);
    let drag = bushing.damping * rate;
    let load = bushing.stiffness * at.shape + drag;
    Ok((at.jacobian.tr_mul(&load), rate.dot(&drag)))
}

/// Energy ½ eᵀ K e that its springs hold, J.
///
/// # Errors
/// Wrong length or number in `q`, unknown frame.
pub fn energy(mechanism: &Mechanism, ws: &mut Workspace, q: &[f64], bushing: &Bushing) -> Result<f64> {
    let at = deformation(mechanism, ws, q, bushing)?;
    Ok(0.5 * at.shape.dot(&(bushing.stiffness * at.shape)))
}

/// Adds the bushing's tangent damping EᵀDE and tangent stiffness EᵀKE + (∂Eᵀ/∂q) load to `out`.
///
/// # Errors
/// Wrong length or number in an argument, unknown frame.
pub fn add_tangent(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    bushing: &Bushing,
    out: &mut Tangent,
) -> Result<()> {
    mechanism.check("qd", qd)?;
    let at = deformation(mechanism, ws, q, bushing)?;
    let n = mechanism.n();
    let load =
        bushing.stiffness * at.shape + bushing.damping * (&at.jacobian * DVector::from_column_slice(qd));
    out.damping += at.jacobian.tr_mul(&(bushing.damping * &at.jacobian));
    out.stiffness += at.jacobian.tr_mul(&(bushing.stiffness * &at.jacobian));
    let moving = qd.iter().any(|&v| v != 0.0);
    if load == Vector6::zeros() && !moving {
        return Ok(());
    }
    for j in 0..n {
        let mut rate = Vector6::zeros();
        for i in 0..n {
            let change = jacobian_change(mechanism, ws, bushing, &at, i, j)?;
            out.stiffness[(i, j)] += change.dot(&load);
            rate += change * qd[i];
        }
        let drag = at.jacobian.tr_mul(&(bushing.damping * rate));
        for i in 0..n {
            out.stiffness[(i, j)] += drag[i];
        }
    }
    Ok(())
}

fn deformation(
    mechanism: &Mechanism,
    ws: &mut Workspace,
    q: &[f64],
    bushing: &Bushing,
) -> Result<Deformation> {
    let relative = relative_pose(mechanism, ws, q, bushing.frame_a, bushing.frame_b)?;
    let a = ws.frame_pose(mechanism, bushing.frame_a)?;
    let shift = relative.translation;
    let turn = quaternion(&(relative.rotation * bushing.rest.rotation.transpose()));
    let mut axis = Matrix6xX::zeros(mechanism.n());
    for (frame, sign) in [(bushing.frame_b, 1.0), (bushing.frame_a, -1.0)] {
        for &c in mechanism.support(mechanism.frame(frame)?.node) {
            let column = axis.column(c) + a.twist_from_world(&ws.axis[c]) * sign;
            axis.set_column(c, &column);
        }
    }
    let rate = turn_rate(turn.0, &turn.1);
    let mut jacobian = Matrix6xX::zeros(mechanism.n());
    for c in 0..mechanism.n() {
        let s: Twist = axis.column(c).into();
        jacobian.set_column(c, &stack(linear(&s) + angular(&s).cross(&shift), rate * angular(&s)));
    }
    let shape = stack(shift - bushing.rest.translation, 2.0 * turn.1);
    Ok(Deformation { shape, shift, turn, axis, jacobian, a })
}

/// Twice the rate of the quaternion's vector part per angular velocity: w I − [v]×.
fn turn_rate(w: f64, v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * w - skew(v)
}

/// ∂E_i/∂q_j: column i of E as coordinate j moves.
fn jacobian_change(
    mechanism: &Mechanism,
    ws: &Workspace,
    bushing: &Bushing,
    at: &Deformation,
    i: usize,
    j: usize,
) -> Result<Vector6<f64>> {
    let moves = |frame: usize, c: usize| -> Result<bool> {
        Ok(mechanism.support(mechanism.frame(frame)?.node).contains(&c))
    };
    let sign =
        f64::from(u8::from(moves(bushing.frame_b, i)?)) - f64::from(u8::from(moves(bushing.frame_a, i)?));
    if sign == 0.0 {
        return Ok(Vector6::zeros());
    }
    // In a's axes the axis of i turns with j where j stands before i, and against j where j carries frame a.
    let before = mechanism.support(Some(mechanism.node_of(i))).contains(&j);
    let factor = f64::from(u8::from(before)) - f64::from(u8::from(moves(bushing.frame_a, j)?));
    let bent = at.a.twist_from_world(&cross_twist(&ws.axis[j], &ws.axis[i])) * (sign * factor);
    let own: Twist = at.axis.column(i).into();
    let other: Twist = at.axis.column(j).into();
    let rate: Vector6<f64> = at.jacobian.column(j).into();
    let (w, v) = (at.turn.0, &at.turn.1);
    let w_rate = -0.5 * angular(&other).dot(v);
    let v_rate = 0.5 * angular(&rate);
    Ok(stack(
        linear(&bent) + angular(&bent).cross(&at.shift) + angular(&own).cross(&linear(&rate)),
        turn_rate(w, v) * angular(&bent) + turn_rate(w_rate, &v_rate) * angular(&own),
    ))
}
