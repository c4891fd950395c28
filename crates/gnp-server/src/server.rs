//! A server from its start to its end.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use gnp::{Model, Stop};
use gnp_data::Recording;
use tokio::runtime::Builder;
use tokio::time::sleep;

use crate::app::{App, router};
use crate::config::ServerConfig;
use crate::connections::{Client, Connections};
use crate::error::ServerError;
use crate::security::Doorkeeper;

/// How often it is looked whether somebody has asked to stop.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// What is being answered may take so long after that.
const GRACE: Duration = Duration::from_secs(5);
/// So long before that who is still in line is sent away.
const SENT_AWAY: Duration = Duration::from_millis(1000);

/// What listens already, and answers nobody before it has a model and recordings: what is wrong with the settings is said
/// before these are read.
#[derive(Debug)]
pub struct Listening {
    config: ServerConfig,
    listener: TcpListener,
    address: SocketAddr,
    doorkeeper: Doorkeeper,
}

impl Listening {
    /// Listens where `config` says.
    ///
    /// # Errors
    /// When the port is taken or cannot be had; when a host or an origin of the settings is none.
    pub fn begin(config: ServerConfig) -> Result<Self, ServerError> {
        let asked = SocketAddr::new(config.listen, config.port);
        let refused = |source: io::Error| match source.kind() {
            ErrorKind::AddrInUse => ServerError::PortTaken { address: asked },
            _ => ServerError::Listen { address: asked, source },
        };
        let listener = TcpListener::bind(asked).map_err(refused)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let doorkeeper = Doorkeeper::new(&config, address)?;
        Ok(Self { config, listener, address, doorkeeper })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The server of requests about `recordings` and about tracks that a request brings, predicted by `model`. No other file
    /// is read from here on.
    ///
    /// # Errors
    /// When a recording cannot be used, or the model has no card that can be said.
    pub fn serve(self, model: Model, recordings: Vec<Recording>) -> Result<Server, ServerError> {
        let Self { config, listener, address, doorkeeper } = self;
        let app = Arc::new(App::new(config, model, recordings)?);
        Ok(Server { listener, address, doorkeeper, app })
    }
}

/// A server that listens, and answers once it [runs](Server::run).
///
/// ```no_run
/// use gnp::{Machine, Model, Stop};
/// use gnp_server::{Server, ServerConfig};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let model = Model::open(None, &Machine::default())?;
/// let server = Server::bind(ServerConfig::default(), model, Vec::new())?;
/// println!("http://{}/", server.address());
/// server.run(&Stop::new())?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    doorkeeper: Doorkeeper,
    pub(crate) app: Arc<App>,
}

impl Server {
    /// [`Listening::begin`] and [`Listening::serve`] in one.
    ///
    /// # Errors
    /// As these.
    pub fn bind(config: ServerConfig, model: Model, recordings: Vec<Recording>) -> Result<Self, ServerError> {
        Listening::begin(config)?.serve(model, recordings)
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Answers until somebody asks to stop; then it accepts nobody else, and ends when what is being answered is, or after 5 s.
    ///
    /// # Errors
    /// [`ServerError::Io`] when the system gives no threads or takes the socket away.
    pub fn run(self, stop: &Stop) -> Result<(), ServerError> {
        let Self { listener, doorkeeper, app, .. } = self;
        let turns = Arc::clone(&app.turns);
        let threads = app.config.jobs.clamp(1, 4);
        let runtime = Builder::new_multi_thread().worker_threads(threads).enable_all().build()?;
        let ended = runtime.block_on(async {
            let connections = Connections::new(tokio::net::TcpListener::from_std(listener)?);
            let service = router(&app, doorkeeper).into_make_service_with_connect_info::<Client>();
            let serving = axum::serve(connections, service).with_graceful_shutdown(asked_to(stop.clone()));
            let late = async {
                asked_to(stop.clone()).await;
                sleep(GRACE - SENT_AWAY).await;
                turns.close();
                sleep(SENT_AWAY).await;
            };
            tokio::select! {
                ended = serving => ended,
                () = late => Ok(()),
            }
        });
        // Work that nobody waits for any more is left alone.
        runtime.shutdown_background();
        Ok(ended?)
    }
}

async fn asked_to(stop: Stop) {
    while !stop.is_requested() {
        sleep(LOOK_EVERY).await;
    }
}

#[cfg(test)]
mod tests;
