//! Rigid transforms, twists, wrenches and spatial inertias, all in world axes about the world origin.
//!
//! A twist stacks the velocity of the body-fixed point now at the origin over the angular velocity; a wrench stacks the
//! force over the moment about the origin. Seen from one fixed frame, the derivative of a joint axis S_i along an
//! earlier coordinate j is simply S_j × S_i, which is what makes the analytic derivatives short (Featherstone 2008).

use nalgebra::{Matrix3, Matrix6, Unit, Vector3, Vector6};

/// Velocity (linear over angular), m/s and rad/s.
pub type Twist = Vector6<f64>;
/// Force over moment, N and N m.
pub type Wrench = Vector6<f64>;

/// Linear part of a six-vector.
#[inline]
pub fn linear(x: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}

/// Angular part of a six-vector.
#[inline]
pub fn angular(x: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(x[3], x[4], x[5])
}

/// Six-vector from its linear and angular parts.
#[inline]
pub fn stack(linear: Vector3<f64>, angular: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// Skew-symmetric matrix of the cross product, `skew(a) b = a × b`.
#[inline]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rate of change of twist `b` when carried along by twist `a`: a × b.
#[inline]
pub fn cross_twist(a: &Twist, b: &Twist) -> Twist {
    let (va, wa, vb, wb) = (linear(a), angular(a), linear(b), angular(b));
    stack(wa.cross(&vb) + va.cross(&wb), wa.cross(&wb))
}

/// Rate of change of wrench `f` when carried along by twist `a`: a ×* f.
#[inline]
pub fn cross_wrench(a: &Twist, f: &Wrench) -> Wrench {
    let (va, wa, force, moment) = (linear(a), angular(a), linear(f), angular(f));
    stack(wa.cross(&force), wa.cross(&moment) + va.cross(&force))
}

/// Rigid transform T_parent_child: rotation and position of a child frame in its parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Columns are the child's axes in the parent.
    pub rotation: Matrix3<f64>,
    /// Child origin in the parent, m.
    pub translation: Vector3<f64>,
}

impl Transform {
    /// The frame itself.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// T_a_c = T_a_b · T_b_c.
    #[inline]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            rotation: self.rotation * next.rotation,
            translation: self.translation + self.rotation * next.translation,
        }
    }

    /// A twist in world axes about the world origin, seen in this frame about this frame's origin.
    #[inline]
    pub fn twist_from_world(&self, x: &Twist) -> Twist {
        let (v, w) = (linear(x), angular(x));
        let inverse = self.rotation.transpose();
        stack(inverse * (v + w.cross(&self.translation)), inverse * w)
    }
}

/// Rotation about a unit axis by an angle in radians (Rodrigues).
#[inline]
pub fn rotation(axis: &Unit<Vector3<f64>>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let k = skew(axis);
    Matrix3::identity() + k * s + k * k * (1.0 - c)
}

/// Unit quaternion (w, v) of a rotation matrix, with w ≥ 0; exact near identity, where deflections live.
pub fn quaternion(r: &Matrix3<f64>) -> (f64, Vector3<f64>) {
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*r));
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    (sign * q.w, sign * q.imag())
}

/// Mass distribution of a rigid body about the origin of the axes it is expressed in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass: f64,
    /// First moment m·c, kg m.
    pub first: Vector3<f64>,
    /// Inertia tensor about the origin (not the centre of mass), kg m².
    pub second: Matrix3<f64>,
}

impl Inertia {
    /// No mass at all.
    pub fn zero() -> Self {
        Self { mass: 0.0, first: Vector3::zeros(), second: Matrix3::zeros() }
    }

    /// From mass (kg), centre of mass (m) and the tensor about the centre of mass (kg m²), in the same axes.
    pub fn about_com(mass: f64, com: Vector3<f64>, tensor: Matrix3<f64>) -> Self {
        let c = skew(&com);
        Self { mass, first: mass * com, second: tensor - mass * (c * c) }
    }

    /// The same body seen from the frame in which `pose` places the body's own frame.
    #[inline]
    pub fn moved(&self, pose: &Transform) -> Self {
        let (r, p) = (&pose.rotation, &pose.translation);
        let turned = r * self.first;
        let (ph, pp) = (skew(p), skew(&turned));
        // Steiner twice over: about the body origin, then about the origin of `pose`.
        Self {
            mass: self.mass,
            first: turned + self.mass * p,
            second: r * self.second * r.transpose() - self.mass * (ph * ph) - ph * pp - pp * ph,
        }
    }

    /// Momentum (linear over angular) of the body under a twist.
    #[inline]
    pub fn momentum(&self, x: &Twist) -> Wrench {
        let (v, w) = (linear(x), angular(x));
        stack(self.mass * v + w.cross(&self.first), self.second * w + self.first.cross(&v))
    }

    /// Two bodies welded together.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.first += other.first;
        self.second += other.second;
    }

    /// Twice the body-level Coriolis matrix, 2B = (v×*) I − I (v×) + (Iv) ×̄*, where f ×̄* y = y ×* f
    /// (Singh, Russell, Wensing 2022, Eq. 14 in world axes); additive over welded bodies.
    pub fn twice_coriolis(&self, v: &Twist) -> Matrix6<f64> {
        let momentum = self.momentum(v);
        Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|k| {
            let mut unit = Twist::zeros();
            unit[k] = 1.0;
            cross_wrench(v, &self.momentum(&unit)) - self.momentum(&cross_twist(v, &unit))
                + cross_wrench(&unit, &momentum)
        }))
    }
}
