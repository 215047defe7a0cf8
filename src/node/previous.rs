//! What a node is given of its last run.

use maquette_value::{AnyValue, Value};

use super::port::at_port;
use super::{Context, In, PortType};

/// What came to a node, and what it gave, when it ran with the same parameters and files.
pub struct Previous<'a> {
    #[doc(hidden)]
    pub inputs: &'a [AnyValue],
    #[doc(hidden)]
    pub outputs: &'a [AnyValue],
}

impl Previous<'_> {
    /// The value that was at a port.
    pub fn get<T: PortType>(&self, port: &In<T>) -> T::Ref<'_> {
        at_port(self.inputs, port)
    }

    /// Whether the value that is at a port now was there before, too.
    pub fn is_same<T: PortType>(&self, cx: &Context<'_>, port: &In<T>) -> bool {
        cx.inputs[port.slot].hash() == self.inputs[port.slot].hash()
    }

    /// The value of an output, the first one being 0; none if there is no such output, or it is no `T`.
    pub fn output<T: Value>(&self, index: usize) -> Option<&T> {
        self.outputs.get(index)?.get()
    }
}
