//! What iceoryx2 is compared with: UDP over the loopback and Unix sockets, message by message.

use std::io::{Read, Write};
use std::net::UdpSocket;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::bail;
use orime_runtime::now_ns;

/// Bytes of a message in one datagram; the largest that IPv4 carries is 65 507.
const DATAGRAM_BYTES: usize = 60_000;
/// Message number, send time, place in the message.
const HEADER: usize = 24;
/// Message number that ends the bench.
pub const LAST: u64 = u64::MAX;
/// Receive buffer that is asked of the kernel, bytes.
const SOCKET_BYTES: usize = 16 << 20;

/// The sending end of both.
#[derive(Debug)]
pub struct Senders {
    udp: UdpSocket,
    unix: UnixStream,
    datagram: Vec<u8>,
}

impl Senders {
    /// Connects to a receiving process.
    pub fn connect(port: u16, socket: &Path) -> std::io::Result<Self> {
        let udp = UdpSocket::bind("127.0.0.1:0")?;
        udp.connect(("127.0.0.1", port))?;
        let datagram = vec![0; DATAGRAM_BYTES + HEADER];
        Ok(Self { udp, unix: UnixStream::connect(socket)?, datagram })
    }

    /// Sends by UDP, in as many datagrams as it takes.
    pub fn by_udp(&mut self, number: u64, message: &[u8]) -> std::io::Result<()> {
        let sent_ns = now_ns();
        for (k, part) in message.chunks(DATAGRAM_BYTES).enumerate() {
            let offset = (k * DATAGRAM_BYTES) as u64;
            put(&mut self.datagram, [number, sent_ns, offset]);
            self.datagram[HEADER..HEADER + part.len()].copy_from_slice(part);
            self.udp.send(&self.datagram[..HEADER + part.len()])?;
        }
        Ok(())
    }

    /// Sends by the Unix socket, a stream.
    pub fn by_unix(&mut self, number: u64, message: &[u8]) -> std::io::Result<()> {
        put(&mut self.datagram, [number, now_ns(), message.len() as u64]);
        self.unix.write_all(&self.datagram[..HEADER])?;
        self.unix.write_all(message)
    }

    /// Says that nothing more comes; `Err` once the other side is gone.
    pub fn end(&mut self) -> std::io::Result<()> {
        put(&mut self.datagram, [LAST, 0, 0]);
        // One may get lost; the stream's own end does not.
        let _ = self.unix.write_all(&self.datagram[..HEADER]);
        self.udp.send(&self.datagram[..HEADER]).map(drop)
    }
}

fn put(bytes: &mut [u8], words: [u64; 3]) {
    for (place, word) in bytes.chunks_exact_mut(8).zip(words) {
        place.copy_from_slice(&word.to_le_bytes());
    }
}

fn words(bytes: &[u8]) -> [u64; 3] {
    let mut words = [0; 3];
    for (word, chunk) in words.iter_mut().zip(bytes.chunks_exact(8)) {
        let mut eight = [0; 8];
        eight.copy_from_slice(chunk);
        *word = u64::from_le_bytes(eight);
    }
    words
}

/// Receives datagrams; how long each whole message was on its way, nanoseconds.
pub fn receive_udp(
    socket: &UdpSocket,
    message_bytes: usize,
    done: &AtomicBool,
) -> anyhow::Result<Vec<u64>> {
    let mut message = vec![0; message_bytes];
    let mut datagram = vec![0; DATAGRAM_BYTES + HEADER];
    let (mut number, mut got) = (LAST, 0);
    let mut times_ns = Vec::new();
    loop {
        let length = match socket.recv(&mut datagram) {
            Ok(length) if length >= HEADER => length,
            Ok(_) => continue,
            Err(_) if done.load(Ordering::Relaxed) => return Ok(times_ns),
            Err(error) => bail!("receiving by UDP: {error}"),
        };
        let [this, sent_ns, offset] = words(&datagram[..HEADER]);
        if this == LAST {
            return Ok(times_ns);
        }
        if this != number {
            (number, got) = (this, 0);
        }
        let (part, offset) = (&datagram[HEADER..length], offset as usize);
        if let Some(place) = message.get_mut(offset..offset + part.len()) {
            place.copy_from_slice(part);
            got += part.len();
        }
        if got == message_bytes {
            times_ns.push(now_ns().saturating_sub(sent_ns));
        }
    }
}

/// Receives from the one client of a Unix socket; how long each message was on its way.
pub fn receive_unix(listener: &UnixListener, message_bytes: usize) -> anyhow::Result<Vec<u64>> {
    let (mut client, _) = listener.accept()?;
    let mut message = vec![0; message_bytes];
    let mut head = [0; HEADER];
    let mut times_ns = Vec::new();
    loop {
        client.read_exact(&mut head)?;
        let [number, sent_ns, length] = words(&head);
        if number == LAST {
            return Ok(times_ns);
        }
        let Some(place) = message.get_mut(..length as usize) else {
            bail!("a message of {length} bytes came");
        };
        client.read_exact(place)?;
        times_ns.push(now_ns().saturating_sub(sent_ns));
    }
}

/// Asks for a receive buffer that holds whole messages; only the superuser gets more than the
/// system's limit.
pub fn enlarge(socket: &UdpSocket) {
    use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};
    if set_socket_recv_buffer_size_force(socket, SOCKET_BYTES).is_err() {
        // What cannot be had is not had: messages that get lost are counted.
        let _ = set_socket_recv_buffer_size(socket, SOCKET_BYTES);
    }
}
