//! The immutable tree of rigid nodes, coordinates and frames, compiled once from a robot description.

use crate::spatial::{Inertia, Transform};
use crate::{Error, Result};
use nalgebra::{Unit, Vector3};

/// How a node moves against its parent, after its placement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Not at all.
    Fixed,
    /// It turns about a unit axis; the coordinate is in rad.
    Revolute(Unit<Vector3<f64>>),
    /// It slides along a unit axis; the coordinate is in m.
    Prismatic(Unit<Vector3<f64>>),
}

/// One rigid node. A joint with several coordinates is a chain of nodes, the link's mass sitting on the last.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Index of the parent node, `None` for the base; always smaller than the node's own.
    pub parent: Option<usize>,
    /// T_parent_node at coordinate zero.
    pub placement: Transform,
    /// Its one motion, if any.
    pub motion: Motion,
    /// Mass it carries, about its own origin, in its own axes.
    pub inertia: Inertia,
}

/// A named place on a node (names live with the description; here they are indices).
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The node it is fixed to, `None` for the base.
    pub node: Option<usize>,
    /// T_node_frame.
    pub placement: Transform,
}

/// A tree of rigid bodies with minimal coordinates q (Huynh et al. 2021, section 2.1), immutable and shareable.
#[derive(Debug, Clone)]
pub struct Mechanism {
    nodes: Vec<Node>,
    frames: Vec<Frame>,
    gravity: Vector3<f64>,
    coordinate_of_node: Vec<Option<usize>>,
    node_of_coordinate: Vec<usize>,
    /// Per node, the coordinates that move it, base first.
    support: Vec<Vec<usize>>,
}

impl Mechanism {
    /// Checks the tree and numbers its coordinates in node order.
    ///
    /// # Errors
    /// [`Error::ParentOrder`], [`Error::Index`] for a frame on a missing node, [`Error::Value`] for a number that is
    /// not finite or a negative mass.
    pub fn new(nodes: Vec<Node>, frames: Vec<Frame>, gravity: Vector3<f64>) -> Result<Self> {
        let mut coordinate_of_node = Vec::with_capacity(nodes.len());
        let mut node_of_coordinate = Vec::new();
        let mut support: Vec<Vec<usize>> = Vec::with_capacity(nodes.len());
        for (index, node) in nodes.iter().enumerate() {
            if let Some(parent) = node.parent.filter(|&p| p >= index) {
                return Err(Error::ParentOrder { node: index, parent });
            }
            finite("placement", placement_numbers(&node.placement))?;
            let inertia = &node.inertia;
            if let Motion::Revolute(axis) | Motion::Prismatic(axis) = &node.motion {
                finite("axis", axis.iter().copied())?;
            }
            if !(inertia.mass >= 0.0 && inertia.mass.is_finite()) {
                return Err(Error::Value {
                    what: "mass",
                    got: inertia.mass,
                    expected: "a finite mass, zero or more",
                });
            }
            finite("com", inertia.first.iter().copied())?;
            finite("inertia", inertia.second.iter().copied())?;
            let asymmetry = (inertia.second - inertia.second.transpose()).amax();
            if asymmetry > 1e-9 * inertia.second.amax() {
                return Err(Error::Value {
                    what: "asymmetry of inertias",
                    got: asymmetry,
                    expected: "a symmetric tensor",
                });
            }
            let mut path = node.parent.map_or_else(Vec::new, |p| support[p].clone());
            if node.motion == Motion::Fixed {
                coordinate_of_node.push(None);
            } else {
                coordinate_of_node.push(Some(node_of_coordinate.len()));
                path.push(node_of_coordinate.len());
                node_of_coordinate.push(index);
            }
            support.push(path);
        }
        for frame in &frames {
            if let Some(node) = frame.node.filter(|&node| node >= nodes.len()) {
                return Err(Error::Index { what: "node of a frame", count: nodes.len(), got: node });
            }
            finite("placement", placement_numbers(&frame.placement))?;
        }
        finite("gravity", gravity.iter().copied())?;
        Ok(Self { nodes, frames, gravity, coordinate_of_node, node_of_coordinate, support })
    }

    /// Number of coordinates, n.
    pub fn n(&self) -> usize {
        self.node_of_coordinate.len()
    }

    /// Nodes, parents before children.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Acceleration of gravity in world axes, m/s².
    pub fn gravity(&self) -> &Vector3<f64> {
        &self.gravity
    }

    /// The coordinate that moves a node against its parent.
    pub fn coordinate_of(&self, node: usize) -> Option<usize> {
        self.coordinate_of_node[node]
    }

    /// The node that a coordinate moves against its parent.
    pub fn node_of(&self, coordinate: usize) -> usize {
        self.node_of_coordinate[coordinate]
    }

    /// The coordinates that move a node, base first; none for the base.
    pub fn support(&self, node: Option<usize>) -> &[usize] {
        node.map_or(&[], |node| &self.support[node])
    }

    /// One frame by index.
    ///
    /// # Errors
    /// [`Error::Index`] past the end.
    pub fn frame(&self, index: usize) -> Result<&Frame> {
        let count = self.frames.len();
        self.frames.get(index).ok_or(Error::Index { what: "frame", count, got: index })
    }

    /// Refuses a vector that does not hold one finite number per coordinate.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Value`].
    pub fn check(&self, what: &'static str, values: &[f64]) -> Result<()> {
        if values.len() != self.n() {
            return Err(Error::Length { what, needed: self.n(), got: values.len() });
        }
        finite(what, values.iter().copied())
    }
}

/// Refuses numbers that are not finite.
pub(crate) fn finite(what: &'static str, values: impl IntoIterator<Item = f64>) -> Result<()> {
    match values.into_iter().find(|v| !v.is_finite()) {
        Some(got) => Err(Error::Value { what, got, expected: "a finite number" }),
        None => Ok(()),
    }
}

fn placement_numbers(placement: &Transform) -> impl Iterator<Item = f64> + '_ {
    placement.rotation.iter().chain(placement.translation.iter()).copied()
}
