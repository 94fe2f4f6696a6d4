//! One error type; each variant carries what was needed and what was got.

/// A number in few characters, whatever its size.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-4..1e9).contains(&value.abs()) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// What the core refuses to compute.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// An array has the wrong number of entries.
    #[error("{what}: found {got} values, expected {needed}")]
    Length {
        /// Name of the argument.
        what: &'static str,
        /// Length that fits the mechanism.
        needed: usize,
        /// Length that was passed.
        got: usize,
    },
    /// An index points past the end of its table.
    #[error("{what}: found index {got}, expected one below {count}")]
    Index {
        /// Name of the table.
        what: &'static str,
        /// How many entries the table has.
        count: usize,
        /// The index that was passed.
        got: usize,
    },
    /// A node names a parent that does not stand before it.
    #[error("node {node}: found parent {parent}, expected the base or an earlier node")]
    ParentOrder {
        /// The node.
        node: usize,
        /// Its parent.
        parent: usize,
    },
    /// A number is not finite, or lies outside the range where it has a meaning.
    #[error("{what}: found {}, expected {expected}", short(*got))]
    Value {
        /// Name of the quantity.
        what: &'static str,
        /// The number that was passed.
        got: f64,
        /// The admissible range in words.
        expected: &'static str,
    },
    /// The joint-space mass matrix is not positive definite.
    #[error("the mass matrix is not positive definite: some coordinate moves no mass")]
    MassNotPositiveDefinite,
    /// The dynamic stiffness matrix is singular at one evaluation point.
    #[error(
        "the dynamic stiffness is singular at line {line}: an undamped resonance lies exactly at {hz} Hz"
    )]
    Singular {
        /// Index of the evaluation point.
        line: usize,
        /// Im s / 2π there.
        hz: f64,
    },
    /// A modelled response is zero where its logarithm is wanted.
    #[error(
        "the modelled response of output {output} to input {input} is zero at line {line}: it has no logarithm, leave \
         that response out of the fit"
    )]
    ZeroResponse {
        /// Output index.
        output: usize,
        /// Input index.
        input: usize,
        /// Index of the evaluation point.
        line: usize,
    },
}
