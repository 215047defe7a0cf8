//! Where news of the watched files comes from: the system, or looking again and again, or both.

use std::path::{Path, PathBuf};

use super::backend::{Backend, Event, Native, Polling, Sink, is_remote};
use super::list::WatchList;
use crate::Shown;

/// What is watched, by whom.
pub(crate) struct Sources {
    list: WatchList,
    backends: Vec<Box<dyn Backend>>,
    sink: Option<Sink>,
    polled: Option<String>,
}

impl Sources {
    /// Nobody watches.
    pub(crate) fn none() -> Self {
        Self { list: WatchList::default(), backends: Vec::new(), sink: None, polled: None }
    }

    /// The events of the system, or only looking at the files if `poll` says so.
    pub(crate) fn new(sink: Sink, poll: bool) -> Self {
        let mut sources = Self { sink: Some(sink.clone()), ..Self::none() };
        if poll {
            sources.poll("--poll");
            return sources;
        }
        match Native::new(sink) {
            Ok(native) => sources.backends.push(Box::new(native)),
            Err(why) => sources.poll(&why),
        }
        sources
    }

    /// Looks at the files, too.
    fn poll(&mut self, why: &str) {
        if let (Some(sink), None) = (&self.sink, &self.polled) {
            self.backends.push(Box::new(Polling::new(sink.clone())));
            self.polled = Some(why.to_owned());
        }
    }

    /// Why the events of the system do not suffice; none if they do.
    pub(crate) fn polled(&self) -> Option<&str> {
        self.polled.as_deref()
    }

    /// Watches the list that `make` gives instead of the one before; gives the files that may have changed before they were
    /// watched. A folder may appear while its parent is not watched yet, so the list is made until it brings no new folder.
    pub(crate) fn update(&mut self, make: impl Fn() -> WatchList) -> Vec<PathBuf> {
        let mut unseen = Vec::new();
        loop {
            self.list = make();
            if let Some(folder) = self.list.folders().iter().find(|folder| is_remote(folder)) {
                let why = format!("{} may change without events", folder.shown());
                self.poll(&why);
            }
            let new = self.watch();
            if new.is_empty() {
                return unseen;
            }
            for folder in new {
                unseen.extend(self.list.touched(&folder).into_iter().map(|file| file.path.clone()));
            }
        }
    }

    /// The watched files.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.list.files().iter().map(|file| file.path.as_path())
    }

    /// Passes the list on; gives the folders that are new to somebody. Who fails is replaced by looking at the files.
    fn watch(&mut self) -> Vec<PathBuf> {
        let (mut new, mut failed) = (Vec::new(), None);
        self.backends.retain_mut(|backend| match backend.watch(&self.list) {
            Ok(folders) => {
                new.extend(folders);
                true
            }
            Err(why) => {
                failed = Some(why);
                false
            }
        });
        if let Some(why) = failed {
            self.poll(&why);
            new.extend(self.watch());
        }
        new
    }

    /// The files about which an event may say something.
    pub(crate) fn touched(&mut self, event: &Event) -> Vec<PathBuf> {
        let paths = match event {
            Event::Lost => return self.paths().map(Path::to_owned).collect(),
            Event::Touched(paths) | Event::Growing(paths) | Event::Closed(paths) => paths,
            Event::Moved(paths) => {
                for path in paths {
                    self.backends.iter_mut().for_each(|backend| backend.renew(path));
                }
                paths
            }
        };
        let mut files: Vec<PathBuf> = paths
            .iter()
            .flat_map(|path| self.list.touched(path))
            .map(|file| file.path.clone())
            .collect();
        files.sort_unstable();
        files.dedup();
        files
    }
}
