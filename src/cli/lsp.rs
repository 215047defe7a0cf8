//! `maquette lsp`: the language server for editors.

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use maquette_graph::catalog::Catalog;
use maquette_lsp::{Setup, serve};

use super::cache_options::CacheOptions;
use super::{Exit, eprint};

#[derive(Args)]
pub(crate) struct Lsp {
    /// Communicate over stdin and stdout. This is the default and the only way.
    #[arg(long)]
    stdio: bool,
    /// Append every message between the editor and the server to this file.
    #[arg(long, value_name = "FILE", env = "MAQUETTE_LSP_LOG")]
    log: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
}

impl Lsp {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        // Use one thread, because the server only reads the cache and never evaluates.
        let session = match self.cache.session(1, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        if self.cache.hides_server() {
            eprint(
                "warning: --cache-remote contains a name or a password and is left out of runs\n  = help: set MAQUETTE_CACHE_REMOTE instead\n",
            );
        }
        let program = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("maquette"));
        let (connection, threads) = match maquette_lsp::stdio(self.log.as_deref()) {
            Ok(opened) => opened,
            Err(error) => return Exit::Usage(format!("cannot write the log: {error}")),
        };
        let ended =
            serve(&connection, Setup { session, program, arguments: self.cache.arguments() });
        drop(connection);
        let written = threads.join();
        match (ended, written) {
            (Ok(()), Err(error)) if error.kind() != ErrorKind::BrokenPipe => {
                Exit::Usage(format!("cannot communicate with the editor: {error}"))
            }
            (Ok(()), _) => Exit::Done,
            (Err(why), _) => {
                eprint(&format!("error: {why}\n"));
                Exit::Failed
            }
        }
    }
}
