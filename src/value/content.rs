//! Encoding, decoding and memory size of the fields of value types.

use bytemuck::{AnyBitPattern, NoUninit};
use nalgebra::Matrix4;

use super::{Column, DecodeError, Decoder, Encoder, Value};

/// A field of a value, or the whole content of a value.
pub(crate) trait Content: Sized {
    /// Writes the field, as [`Value::encode`] writes a value.
    fn encode(&self, to: &mut Encoder);

    /// Reads what [`Content::encode`] wrote.
    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError>;

    /// The memory outside of the field itself that the field holds, in bytes.
    fn size(&self) -> usize {
        0
    }
}

/// Implements `encode`, `decode` and `size` for a struct whose content is its fields in the given order.
macro_rules! content_of_fields {
    ($($field:ident)+) => {
        fn encode(&self, to: &mut $crate::Encoder) {
            $($crate::content::Content::encode(&self.$field, to);)+
        }

        fn decode(from: &mut $crate::Decoder<'_>) -> Result<Self, $crate::DecodeError> {
            $(let $field = $crate::content::Content::decode(from)?;)+
            Ok(Self { $($field),+ })
        }

        fn size(&self) -> usize {
            0 $(+ $crate::content::Content::size(&self.$field))+
        }
    };
}

pub(crate) use content_of_fields;

impl<T: Value> Content for T {
    fn encode(&self, to: &mut Encoder) {
        to.value(self);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.value()
    }

    fn size(&self) -> usize {
        Value::size(self)
    }
}

impl<T: AnyBitPattern + NoUninit + Send + Sync> Content for Column<T> {
    fn encode(&self, to: &mut Encoder) {
        to.column(self);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.column()
    }

    fn size(&self) -> usize {
        self.size()
    }
}

impl<T: Content> Content for Option<T> {
    fn encode(&self, to: &mut Encoder) {
        to.option(self.as_ref(), |to, part| part.encode(to));
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.option(T::decode)
    }

    fn size(&self) -> usize {
        self.as_ref().map_or(0, T::size)
    }
}

impl Content for usize {
    fn encode(&self, to: &mut Encoder) {
        to.counts(&[*self]);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.counts().map(|[count]| count)
    }
}

impl Content for [usize; 2] {
    fn encode(&self, to: &mut Encoder) {
        to.counts(self);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.counts()
    }
}

impl Content for bool {
    fn encode(&self, to: &mut Encoder) {
        to.plain(&u8::from(*self));
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.plain::<u8>().map(|flag| flag == 1)
    }
}

/// Numbers that are written by [`Encoder::plain`].
macro_rules! plain_content {
    ($($number:ty)+) => {$(
        impl Content for $number {
            fn encode(&self, to: &mut Encoder) {
                to.plain(self);
            }

            fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
                from.plain()
            }
        }
    )+};
}

plain_content!(f64 [f64; 2]);

/// A motion from one coordinate frame to another. The matrix is written column by column.
impl Content for Matrix4<f64> {
    fn encode(&self, to: &mut Encoder) {
        let columns: [[f64; 4]; 4] = (*self).into();
        to.plain(&columns);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        from.plain::<[[f64; 4]; 4]>().map(Self::from)
    }
}
