//! The sources of file events: the operating system, polling, or both.

use std::path::{Path, PathBuf};

use super::backend::{Backend, Event, Native, Polling, Sink, is_remote};
use super::list::WatchList;
use crate::DisplayPath;

/// The watched files and the backends that watch them.
pub(crate) struct Sources {
    list: WatchList,
    backends: Vec<Box<dyn Backend>>,
    sink: Option<Sink>,
    polled: Option<String>,
}

impl Sources {
    /// Creates sources that watch no files.
    pub(crate) fn empty() -> Self {
        Self { list: WatchList::default(), backends: Vec::new(), sink: None, polled: None }
    }

    /// Creates sources that use the events of the operating system, or only polling if `poll` is true.
    pub(crate) fn new(sink: Sink, poll: bool) -> Self {
        let mut sources = Self { sink: Some(sink.clone()), ..Self::empty() };
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

    /// Starts to poll the files. `why` is the reason, which is shown to the user.
    fn poll(&mut self, why: &str) {
        if let (Some(sink), None) = (&self.sink, &self.polled) {
            self.backends.push(Box::new(Polling::new(sink.clone())));
            self.polled = Some(why.to_owned());
        }
    }

    /// Returns the reason why files are polled, or `None` if they are not.
    pub(crate) fn polling_reason(&self) -> Option<&str> {
        self.polled.as_deref()
    }

    /// Watches the paths in the list that `make` returns. Returns the files that may have changed before they were watched. `make` is
    /// called until its list contains no new folders, because a folder may appear before its parent is watched.
    pub(crate) fn update(&mut self, make: impl Fn() -> WatchList) -> Vec<PathBuf> {
        let mut unseen = Vec::new();
        loop {
            self.list = make();
            if let Some(folder) = self.list.folders().iter().find(|folder| is_remote(folder)) {
                let why = format!("{} may change without events", folder.for_display());
                self.poll(&why);
            }
            let new = self.watch();
            if new.is_empty() {
                return unseen;
            }
            for folder in new {
                unseen
                    .extend(self.list.files_at(&folder).into_iter().map(|file| file.path.clone()));
            }
        }
    }

    /// Returns the paths of the watched files.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.list.files().iter().map(|file| file.path.as_path())
    }

    /// Gives the list to all backends. Returns the folders that are watched for the first time. If a backend fails, polling replaces it.
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

    /// Returns the watched files that an event may concern.
    pub(crate) fn affected_files(&mut self, event: &Event) -> Vec<PathBuf> {
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
            .flat_map(|path| self.list.files_at(path))
            .map(|file| file.path.clone())
            .collect();
        files.sort_unstable();
        files.dedup();
        files
    }
}
