//! The scans in a folder: what each file holds, and which picture belongs to which scan.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_value::plain::ending;
use maquette_value::{AnyValue, Image, Mesh, Points, RangeImage, Value};

use crate::Shown;
use crate::counted;

/// The types of values that are scans, in the order in which a file is tried.
pub(super) const KINDS: [&str; 3] = [RangeImage::NAME, Mesh::NAME, Points::NAME];

/// So many files of a folder are looked into.
const MOST: usize = 1000;

/// A scan and what belongs to it.
pub(super) struct Scan {
    pub(super) file: PathBuf,
    /// The type of its value.
    pub(super) kind: &'static str,
    /// The picture beside it.
    pub(super) picture: Option<PathBuf>,
    /// Whether its camera is known: a camera file beside it may be for another grid.
    has_camera: bool,
    /// Whether it is so small that its numbers must be meters.
    pub(super) in_meters: bool,
    /// Whether what it shows lies behind the sensor, as in files whose y goes up.
    pub(super) y_up: bool,
}

/// What there is in a folder.
pub(super) struct Scans {
    pub(super) folder: PathBuf,
    /// The captures of one thing, in the order of their names: those whose names differ by numbers alone.
    pub(super) all: Vec<Scan>,
    /// Other files that could be read, and what they are.
    others: Vec<(PathBuf, &'static str)>,
    /// Of each file that looks like one of these but cannot be read, which it is, and why not.
    pub(super) unread: Vec<String>,
}

impl Scans {
    /// The scans in a folder and the folders in it, or in one file.
    ///
    /// # Errors
    /// In words: nothing is there.
    pub(super) fn of(path: &Path, catalog: &Catalog) -> Result<Self, String> {
        let is_folder = fs::metadata(path)
            .map_err(|error| format!("cannot read {}: {error}", path.shown()))?
            .is_dir();
        let folder = if is_folder { path.to_owned() } else { path.with_file_name("") };
        let mut files = Vec::new();
        match is_folder {
            true => collect(path, 2, &mut files),
            false => {
                collect(&folder, 0, &mut files);
                files.retain(|file| file == path || !holds_a_scan(file, catalog));
            }
        }
        let (mut scans, mut pictures, mut unread) = (Vec::new(), Vec::new(), Vec::new());
        for file in files {
            match Found::of(&file, catalog) {
                Ok(Some(Found::Scan(scan))) => scans.push(scan),
                Ok(Some(Found::Picture(size))) => pictures.push((file, size)),
                Ok(None) => {}
                Err(why) => unread.push(why.replace('\n', " ")),
            }
        }
        let mut groups: BTreeMap<(usize, bool, String), Vec<Scan>> = BTreeMap::new();
        for (scan, size) in scans {
            let name = without_numbers(&scan.file);
            let rank = KINDS.iter().position(|kind| *kind == scan.kind).unwrap_or_default();
            let picture = picture_of(&scan.file, size, &pictures);
            let scan = Scan { picture, ..scan };
            groups.entry((rank, scan.picture.is_none(), name)).or_default().push(scan);
        }
        let mut groups = Vec::from_iter(groups);
        // Of what is of one kind first what has a camera, then the most captures, and of one file each the largest.
        groups.sort_by_key(|((rank, is_plain, _), scans)| {
            let bytes = scans.first().and_then(|scan| fs::metadata(&scan.file).ok());
            let bytes = bytes.map_or(0, |metadata| metadata.len());
            let has_camera = scans.iter().all(|scan| scan.has_camera);
            (*rank, *is_plain, !has_camera, Reverse(scans.len()), Reverse(bytes))
        });
        let mut groups = groups.into_iter().map(|(_, scans)| scans);
        let all = groups.next().unwrap_or_default();
        let mut others: Vec<_> = groups.flatten().map(|scan| (scan.file, scan.kind)).collect();
        fn is_used(file: &Path, all: &[Scan]) -> bool {
            all.iter().any(|scan| scan.picture.as_deref() == Some(file))
        }
        let pictures = pictures.into_iter().filter(|(file, _)| !is_used(file, &all));
        others.extend(pictures.map(|(file, _)| (file, Image::NAME)));
        Ok(Self { folder, all, others, unread })
    }

    /// What is said if no recipe fits.
    pub(super) fn nothing(&self) -> String {
        let folder = match self.folder.as_os_str().is_empty() {
            true => ".".into(),
            false => self.folder.display().to_string(),
        };
        let wanted = "a range image, a mesh or points";
        let nothing = match self.others.len() {
            0 => format!("there is no scan in {folder}: {wanted}"),
            count => {
                let pictures = counted(count, "picture");
                format!("there is no scan in {folder} beside {pictures}: {wanted}")
            }
        };
        [nothing].iter().chain(&self.unread).map(String::as_str).collect::<Vec<_>>().join("\n")
    }

    /// What there is, for a message.
    pub(super) fn in_words(&self) -> String {
        match self.all.first() {
            None => "no scan".to_owned(),
            Some(scan) => {
                let count = self.all.len();
                let picture = if scan.picture.is_some() { " with a picture" } else { "" };
                format!("{count} {}{picture}", in_words(scan.kind, count))
            }
        }
    }

    /// The files that could be read and are not `used`, and what they are.
    pub(super) fn unused(&self, used: &[&Scan]) -> Vec<(String, &'static str)> {
        let left = self.all.iter().filter(|scan| used.iter().all(|it| it.file != scan.file));
        let left = left.map(|scan| (&scan.file, scan.kind));
        let others = self.others.iter().map(|(file, kind)| (file, *kind));
        left.chain(others).map(|(file, kind)| (file.display().to_string(), kind)).collect()
    }
}

/// A type of scans in words.
pub(super) fn in_words(kind: &str, count: usize) -> &'static str {
    match (kind, count) {
        ("RangeImage", 1) => "range image",
        ("RangeImage", _) => "range images",
        ("Mesh", 1) => "mesh",
        ("Mesh", _) => "meshes",
        _ => "files of points",
    }
}

/// The plain files of a folder in order of their names, and of folders in it; none that are hidden.
fn collect(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) {
    let place = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let Ok(entries) = fs::read_dir(place) else { return };
    let mut names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    names.sort_by_cached_key(|name| by_numbers(&name.to_string_lossy()));
    names.retain(|name| !name.to_string_lossy().starts_with('.'));
    for path in names.into_iter().map(|name| folder.join(name)) {
        if files.len() < MOST && path.is_file() {
            files.push(path);
        } else if 0 < depth && path.is_dir() {
            collect(&path, depth - 1, files);
        }
    }
}

/// A name by which 2 comes before 10: a scanner counts, and so does a turntable.
fn by_numbers(name: &str) -> String {
    fn is_digit(c: char) -> bool {
        c.is_ascii_digit()
    }
    let mut key = String::new();
    let mut rest = name;
    while let Some(start) = rest.find(is_digit) {
        let (text, from) = rest.split_at(start);
        let (digits, behind) = from.split_at(from.find(|c| !is_digit(c)).unwrap_or(from.len()));
        key += text;
        key += &format!("{digits:0>20}");
        rest = behind;
    }
    key + rest
}

/// What a file holds.
enum Found {
    /// With its width and height, if it is a grid.
    Scan((Scan, Option<[usize; 2]>)),
    Picture([usize; 2]),
}

impl Found {
    /// What a file holds, if anything.
    ///
    /// # Errors
    /// It should hold something by its ending, but nothing can be read: why.
    fn of(file: &Path, catalog: &Catalog) -> Result<Option<Self>, String> {
        let readers = catalog.readers();
        let endings = |kind: &str| readers.endings(Some(kind)).contains(&&ending(file)[..]);
        let (mut is_read, mut why) = (false, None);
        for kind in KINDS.into_iter().chain([Image::NAME]) {
            let Some(kind) = catalog.value_type(kind).filter(|kind| endings(kind.name)) else {
                continue;
            };
            match readers.open(file, Some(kind)) {
                Ok((value, _)) => {
                    is_read = true;
                    let picture = value.get::<Image>();
                    let picture = picture.map(|it| Self::Picture([it.width(), it.height()]));
                    if let Some(found) = scan(file, &value).map(Self::Scan).or(picture) {
                        return Ok(Some(found));
                    }
                }
                // What is asked for last, points or a picture, asks for the least.
                Err(error) => why = Some(error),
            }
        }
        match why {
            Some(why) if !is_read => Err(why),
            _ => Ok(None),
        }
    }
}

fn holds_a_scan(file: &Path, catalog: &Catalog) -> bool {
    matches!(Found::of(file, catalog), Ok(Some(Found::Scan(_))))
}

/// A value as a scan, if it is one: a mesh has faces, and a depth map is one beside its camera alone.
fn scan(file: &Path, value: &AnyValue) -> Option<(Scan, Option<[usize; 2]>)> {
    let has_camera = value.get::<RangeImage>().is_some_and(|range| range.camera().is_some());
    let (bounds, size) = if let Some(range) = value.get::<RangeImage>() {
        let there = range.points().iter().filter(|point| point.x.is_finite());
        (maquette_value::bounds(there), Some([range.width(), range.height()]))
    } else if let Some(mesh) = value.get::<Mesh>() {
        (mesh.bounds().filter(|_| !mesh.faces().is_empty()), None)
    } else {
        (value.get::<Points>()?.bounds(), None)
    };
    let (low, high) = bounds?;
    let is_grid = size.is_some();
    let scan = Scan {
        file: file.to_owned(),
        kind: value.kind().name,
        picture: None,
        has_camera,
        // Surveys are in meters by their formats. No scanner has a field of two centimeters, and few see twenty meters.
        in_meters: in_meters(file) || (high - low).norm() < 20.0,
        y_up: is_grid && high.z <= 0.0,
    };
    Some((scan, size))
}

/// Whether numbers are meters by the format of a file.
pub(crate) fn in_meters(file: &Path) -> bool {
    ["las", "laz", "e57"].contains(&&ending(file)[..])
}

/// The name of a file with `#` in place of its numbers, so that those of several captures are the same, as they are in several folders.
fn without_numbers(file: &Path) -> String {
    let text = file.file_name().unwrap_or_default().to_string_lossy();
    let mut name = String::new();
    for c in text.chars() {
        match c.is_ascii_digit() {
            true if name.ends_with('#') => {}
            true => name.push('#'),
            false => name.push(c),
        }
    }
    name
}

/// The picture that belongs to a scan: in its folder, of a name that begins as its own does the longest; of those one that is called after
/// colors, and one of the grid's size.
fn picture_of(
    scan: &Path,
    size: Option<[usize; 2]>,
    pictures: &[(PathBuf, [usize; 2])],
) -> Option<PathBuf> {
    fn stem(file: &Path) -> String {
        file.file_stem().unwrap_or_default().to_string_lossy().to_lowercase()
    }
    let own = stem(scan);
    let beside = pictures.iter().filter(|(file, _)| file.parent() == scan.parent());
    let best = beside.max_by_key(|(file, picture)| {
        let name = stem(file);
        let common = own.chars().zip(name.chars()).take_while(|(a, b)| a == b).count();
        let is_color = ["color", "colour", "rgb", "texture"].iter().any(|it| name.contains(it));
        let is_depth = ["depth", "mask", "range"].iter().any(|it| name.contains(it));
        (!is_depth, common, is_color, size == Some(*picture), Reverse(name))
    });
    best.map(|(file, _)| file.clone())
}
