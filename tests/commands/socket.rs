//! A connection that survives signals.

use std::io::{ErrorKind, Read, Result, Write};
use std::net::TcpStream;

/// A TCP connection whose reads and writes go on when a signal interrupts them, as reads with a timeout are when the process is stopped and
/// continued.
pub(crate) struct Socket(pub(crate) TcpStream);

impl Read for Socket {
    fn read(&mut self, into: &mut [u8]) -> Result<usize> {
        uninterrupted(|| self.0.read(into))
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        uninterrupted(|| self.0.write(bytes))
    }

    fn flush(&mut self) -> Result<()> {
        uninterrupted(|| self.0.flush())
    }
}

fn uninterrupted<T>(mut act: impl FnMut() -> Result<T>) -> Result<T> {
    loop {
        match act() {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}
