//! Little-endian fields of messages, checked against the message's end.

/// Reads a message front to back; `None` past its end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
    /// Where alignment counts from; messages of ROS 1 are packed.
    aligned_from: Option<usize>,
}

impl<'a> Bytes<'a> {
    /// A message of ROS 1.
    pub fn packed(all: &'a [u8]) -> Self {
        Self { all, at: 0, aligned_from: None }
    }

    /// A message of ROS 2: CDR behind its four bytes of head; `None` unless little-endian.
    pub fn cdr(all: &'a [u8]) -> Option<Self> {
        (all.get(..2)? == [0, 1]).then_some(Self { all, at: 4, aligned_from: Some(4) })
    }

    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let found = self.all.get(self.at..end)?;
        self.at = end;
        Some(found)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        if let Some(from) = self.aligned_from {
            self.at = from + (self.at - from).next_multiple_of(N);
        }
        self.take(N)?.try_into().ok()
    }

    pub fn u8(&mut self) -> Option<u8> {
        Some(self.take(1)?[0])
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn f32(&mut self) -> Option<f32> {
        self.number().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    pub fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut found = [0.0; N];
        for value in &mut found {
            *value = self.f64()?;
        }
        Some(found)
    }

    /// A sequence of bytes behind its length.
    pub fn sequence(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()?;
        self.take(count as usize)
    }

    /// A text; ROS 2 ends it with a zero that it counts.
    pub fn text(&mut self) -> Option<&'a str> {
        let text = std::str::from_utf8(self.sequence()?).ok()?;
        Some(text.strip_suffix('\0').unwrap_or(text))
    }
}

/// A colour or depth lens, from the fields of a CameraInfo behind its header.
pub(super) fn camera_info(bytes: &mut Bytes<'_>) -> Option<orime_geometry::CameraModel> {
    let (height, width) = (bytes.u32()?, bytes.u32()?);
    let model = bytes.text()?;
    let n_coefficients = bytes.u32()?;
    let mut distortion = [0.0; 5];
    for k in 0..n_coefficients as usize {
        let coefficient = bytes.f64()?;
        if let Some(place) = distortion.get_mut(k) {
            *place = coefficient;
        }
    }
    let [fx_px, _, cx_px, _, fy_px, cy_px, ..] = bytes.f64s::<9>()?;
    let lens =
        orime_geometry::CameraModel { width, height, fx_px, fy_px, cx_px, cy_px, distortion };
    let is_inverse = model.eq_ignore_ascii_case("Inverse Brown Conrady");
    Some(if is_inverse { super::forward_distortion(&lens) } else { lens })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_aligned_in_cdr_and_packed_in_ros_1() {
        // Head, a byte, three of padding, a word, a number of eight bytes that is in place.
        let cdr = [&[0, 1, 0, 0, 7, 9, 9, 9, 5, 0, 0, 0][..], &1.5f64.to_le_bytes()].concat();
        let mut bytes = Bytes::cdr(&cdr).unwrap();
        assert_eq!((bytes.u8(), bytes.u32(), bytes.f64()), (Some(7), Some(5), Some(1.5)));
        let mut packed = Bytes::packed(&[7, 2, 0, 0, 0, b'o', b'k']);
        assert_eq!((packed.u8(), packed.text(), packed.u8()), (Some(7), Some("ok"), None));
    }

    #[test]
    fn lengths_beyond_the_end_are_no_fields() {
        assert_eq!(Bytes::packed(&[255, 255, 255, 255, 1]).sequence(), None);
        assert!(Bytes::cdr(&[0, 0, 0, 0]).is_none(), "big-endian");
    }
}
