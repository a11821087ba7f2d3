//! Tables of codes as text: short in the source, numbers at run time.

/// Codes of `digits` hexadecimal digits each, one after the other; checked at compile time.
pub(super) const fn codes<const N: usize>(digits: usize, text: &str) -> [u64; N] {
    let bytes = text.as_bytes();
    assert!(bytes.len() == N * digits, "the table has another number of codes");
    let mut codes = [0; N];
    let mut k = 0;
    while k < bytes.len() {
        let digit = match bytes[k] {
            byte @ b'0'..=b'9' => byte - b'0',
            byte @ b'a'..=b'f' => byte - b'a' + 10,
            _ => panic!("no hexadecimal digit"),
        };
        codes[k / digits] = codes[k / digits] << 4 | digit as u64;
        k += 1;
    }
    codes
}
