//! The inputs and outputs of the previous run of a node, for incremental updates.

use maquette_value::{AnyValue, Value};

use super::port::value_at;
use super::{Context, In, PortType};

/// The inputs and outputs of the previous run of a node, which had the same parameters and files.
pub struct Previous<'a> {
    #[doc(hidden)]
    pub inputs: &'a [AnyValue],
    #[doc(hidden)]
    pub outputs: &'a [AnyValue],
}

impl Previous<'_> {
    /// Returns the value that a port had in the previous run.
    pub fn get<T: PortType>(&self, port: &In<T>) -> T::Ref<'_> {
        value_at(self.inputs, port)
    }

    /// Returns true if the value at a port is the same as in the previous run.
    pub fn is_same<T: PortType>(&self, cx: &Context<'_>, port: &In<T>) -> bool {
        cx.inputs[port.slot].hash() == self.inputs[port.slot].hash()
    }

    /// Returns the output with this index, from 0, of the previous run. `None` if there is no such output or if its type is not `T`.
    pub fn output<T: Value>(&self, index: usize) -> Option<&T> {
        self.outputs.get(index)?.get()
    }
}
