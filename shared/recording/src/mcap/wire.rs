//! The protobuf wire format, as much of it as Foxglove's schemas use.
//!
//! Written by hand so that an image's bytes go straight from the frame into the message's buffer
//! and back: generated types own their bytes, which would cost two whole-image copies a frame.

/// Appends fields to a message.
#[derive(Debug)]
pub(super) struct Fields<'a>(pub(super) &'a mut Vec<u8>);

impl Fields<'_> {
    fn key(&mut self, tag: u32, wire_type: u8) {
        self.varint(u64::from(tag) << 3 | u64::from(wire_type));
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    pub(super) fn integer(&mut self, tag: u32, value: u64) {
        self.key(tag, 0);
        self.varint(value);
    }

    pub(super) fn double(&mut self, tag: u32, value: f64) {
        self.key(tag, 1);
        self.0.extend(value.to_le_bytes());
    }

    pub(super) fn fixed32(&mut self, tag: u32, value: u32) {
        self.key(tag, 5);
        self.0.extend(value.to_le_bytes());
    }

    pub(super) fn bytes(&mut self, tag: u32, value: &[u8]) {
        self.key(tag, 2);
        self.varint(value.len() as u64);
        self.0.extend_from_slice(value);
    }

    pub(super) fn string(&mut self, tag: u32, value: &str) {
        self.bytes(tag, value.as_bytes());
    }

    /// A packed list of doubles.
    pub(super) fn doubles(&mut self, tag: u32, values: &[f64]) {
        self.key(tag, 2);
        self.varint(8 * values.len() as u64);
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    /// A nested message, written by `fill`.
    pub(super) fn message(&mut self, tag: u32, fill: impl FnOnce(&mut Fields<'_>)) {
        self.key(tag, 2);
        let start = self.0.len();
        fill(&mut Fields(self.0));
        // The length stands before the content but is known only after it.
        let content = self.0.len() - start;
        self.varint(content as u64);
        let length = self.0.len() - start - content;
        self.0[start..].rotate_right(length);
    }
}

/// One field's value as it stands on the wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    Integer(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    pub(super) fn double(self) -> Result<f64, Malformed> {
        if let Value::Fixed64(bytes) = self {
            return Ok(f64::from_le_bytes(bytes));
        }
        Err(Malformed("a field is no double"))
    }

    pub(super) fn u32(self) -> Result<u32, Malformed> {
        if let Value::Fixed32(bytes) = self {
            return Ok(u32::from_le_bytes(bytes));
        }
        Err(Malformed("a field is no fixed32"))
    }

    pub(super) fn bytes(self) -> Result<&'a [u8], Malformed> {
        if let Value::Bytes(bytes) = self {
            return Ok(bytes);
        }
        Err(Malformed("a field is no bytes, string or message"))
    }

    pub(super) fn string(self) -> Result<&'a str, Malformed> {
        std::str::from_utf8(self.bytes()?).map_err(|_| Malformed("a string is not UTF-8"))
    }

    /// A packed list of exactly `N` doubles.
    pub(super) fn doubles<const N: usize>(self) -> Result<[f64; N], Malformed> {
        let bytes = self.bytes()?;
        if bytes.len() != 8 * N {
            return Err(Malformed("a list of numbers has not the length that is needed"));
        }
        let mut values = [0.0; N];
        for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(8)) {
            *value = f64::from_le_bytes(bytes.try_into().unwrap_or_default());
        }
        Ok(values)
    }
}

/// What is wrong with a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Malformed(pub(super) &'static str);

/// Splits a varint off the front of `bytes`.
pub(super) fn take_varint(bytes: &mut &[u8]) -> Result<u64, Malformed> {
    let mut value = 0;
    for k in 0..10 {
        let (first, rest) = bytes.split_first().ok_or(Malformed("ends inside a number"))?;
        *bytes = rest;
        value |= u64::from(first & 0x7f) << (7 * k);
        if first & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(Malformed("holds a number of more than ten bytes"))
}

/// The fields of a message, in the order in which they stand.
pub(super) fn fields(
    mut message: &[u8],
) -> impl Iterator<Item = Result<(u32, Value<'_>), Malformed>> {
    std::iter::from_fn(move || {
        if message.is_empty() {
            return None;
        }
        let field = take_field(&mut message);
        if field.is_err() {
            message = &[];
        }
        Some(field)
    })
}

fn take<'a>(message: &mut &'a [u8], length: u64) -> Result<&'a [u8], Malformed> {
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    let (value, rest) = message.split_at_checked(length).ok_or(Malformed("ends inside a field"))?;
    *message = rest;
    Ok(value)
}

pub(super) fn take_field<'a>(message: &mut &'a [u8]) -> Result<(u32, Value<'a>), Malformed> {
    let key = take_varint(message)?;
    let tag = u32::try_from(key >> 3).map_err(|_| Malformed("holds an impossible field"))?;
    let value = match key & 7 {
        0 => Value::Integer(take_varint(message)?),
        1 => Value::Fixed64(take(message, 8)?.try_into().unwrap_or_default()),
        5 => Value::Fixed32(take(message, 4)?.try_into().unwrap_or_default()),
        2 => {
            let length = take_varint(message)?;
            Value::Bytes(take(message, length)?)
        }
        _ => return Err(Malformed("holds a field of an unknown kind")),
    };
    Ok((tag, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_those_of_the_protobuf_documentation() {
        // https://protobuf.dev/programming-guides/encoding: `a: 150`, `b: "testing"`, and
        // `c: {a: 150}`.
        let mut bytes = Vec::new();
        let mut message = Fields(&mut bytes);
        message.integer(1, 150);
        message.string(2, "testing");
        message.message(3, |c| c.integer(1, 150));
        let expected = b"\x08\x96\x01\x12\x07testing\x1a\x03\x08\x96\x01";
        assert_eq!(bytes, expected);
        let read: Vec<_> = fields(&bytes).map(Result::unwrap).collect();
        assert_eq!(read[0], (1, Value::Integer(150)));
        assert_eq!(read[1].1.string().unwrap(), "testing");
        assert_eq!(read[2], (3, Value::Bytes(&[8, 0x96, 1])));
    }

    #[test]
    fn long_nested_messages_have_long_lengths() {
        let mut bytes = Vec::new();
        Fields(&mut bytes).message(1, |inner| inner.bytes(2, &[7; 300]));
        // 300 = 0b10_0101100; the content is 300 and three bytes of key and length.
        assert_eq!(bytes[..6], [0x0a, 0xaf, 0x02, 0x12, 0xac, 0x02]);
        assert_eq!(bytes.len(), 3 + 303);
    }

    #[test]
    fn every_cut_is_noticed_or_ends_between_fields() {
        let mut bytes = Vec::new();
        let mut message = Fields(&mut bytes);
        message.double(1, 0.1);
        message.doubles(5, &[1.0, 2.0]);
        message.fixed32(300, 9);
        let whole = [9, 9 + 18, bytes.len()];
        for cut in 1..=bytes.len() {
            let ok = fields(&bytes[..cut]).all(|field| field.is_ok());
            assert_eq!(ok, whole.contains(&cut), "cut at {cut}");
        }
    }
}
