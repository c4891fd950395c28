//! Connections: how many there may be, and for how long one may go on without an answer.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep, sleep_until};

/// Most connections at once. Another one waits until one ends: a file descriptor each, of which systems give 1024.
const MOST: usize = 512;
/// After so long without a byte of an answer a connection is closed, also where its client goes on to send: longer than any
/// answer takes.
const IDLE: Duration = Duration::from_secs(60);

/// Accepts connections, a bounded number at once.
pub(crate) struct Connections {
    listener: TcpListener,
    room: Arc<Semaphore>,
    idle: Duration,
}

impl Connections {
    pub(crate) fn new(listener: TcpListener) -> Self {
        Self { listener, room: Arc::new(Semaphore::new(MOST)), idle: IDLE }
    }
}

impl Listener for Connections {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            // Never closed.
            let Ok(place) = Arc::clone(&self.room).acquire_owned().await else { continue };
            match self.listener.accept().await {
                Ok((stream, from)) => {
                    // Answers are small and each is waited for.
                    let _ = stream.set_nodelay(true);
                    return (Connection::new(stream, place, self.idle), from);
                }
                // No file descriptor is left, or the connection has gone: another one may come.
                Err(_) => sleep(Duration::from_millis(100)).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Whose connection it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Client(pub(crate) IpAddr);

impl Connected<IncomingStream<'_, Connections>> for Client {
    fn connect_info(stream: IncomingStream<'_, Connections>) -> Self {
        Self(stream.remote_addr().ip())
    }
}

/// A connection that ends when nothing is answered.
pub(crate) struct Connection {
    stream: TcpStream,
    idle: Duration,
    patience: Pin<Box<Sleep>>,
    _place: OwnedSemaphorePermit,
}

impl Connection {
    fn new(stream: TcpStream, place: OwnedSemaphorePermit, idle: Duration) -> Self {
        Self { stream, idle, patience: Box::pin(sleep_until(Instant::now() + idle)), _place: place }
    }

    /// Fails when there was no answer for too long.
    fn patient(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        match self.patience.as_mut().poll(context) {
            Poll::Ready(()) => Err(io::ErrorKind::TimedOut.into()),
            Poll::Pending => Ok(()),
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        self.patient(context)?;
        Pin::new(&mut self.stream).poll_read(context, into)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, from: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, from);
        if written.is_ready() {
            let again = Instant::now() + self.idle;
            self.patience.as_mut().reset(again);
        } else {
            self.patient(context)?;
        }
        written
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::io::Write as _;

    use super::*;

    /// Bytes of one read.
    async fn read(connection: &mut Connection) -> io::Result<usize> {
        let mut bytes = [0; 8];
        let mut into = ReadBuf::new(&mut bytes);
        poll_fn(|context| Pin::new(&mut *connection).poll_read(context, &mut into)).await?;
        Ok(into.filled().len())
    }

    /// Who sends a byte now and then and no request does not stay.
    #[tokio::test]
    async fn a_connection_that_drips_is_closed() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let mut connections = Connections { idle: Duration::from_millis(300), ..Connections::new(listener) };
        let dripping = std::thread::spawn(move || {
            let mut client = std::net::TcpStream::connect(address).unwrap();
            while client.write_all(b"x").is_ok() {
                std::thread::sleep(Duration::from_millis(30));
            }
        });
        let (mut connection, _) = connections.accept().await;
        let mut bytes = 0;
        let error = loop {
            match read(&mut connection).await {
                Ok(more) => bytes += more,
                Err(error) => break error,
            }
            assert!(bytes < 600, "it goes on and on");
        };
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert!(bytes > 1, "{bytes}");
        // An answer gives it time again.
        poll_fn(|context| Pin::new(&mut connection).poll_write(context, b"y")).await.unwrap();
        assert!(read(&mut connection).await.is_ok());
        drop(connection);
        dripping.join().unwrap();
    }
}
