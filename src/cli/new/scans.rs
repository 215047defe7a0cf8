//! Finds the scans in a folder, and the picture that belongs to each of them.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_value::fs::extension;
use maquette_value::{AnyValue, Image, Mesh, Points, RangeImage, Value};

use crate::DisplayPath;
use crate::format_count;

/// The value types of scans, in the order in which they are tried for a file.
pub(super) const KINDS: [&str; 3] = [RangeImage::NAME, Mesh::NAME, Points::NAME];

/// The maximum number of files in a folder that are examined.
const MAX_FILES: usize = 1000;

/// A scan file and its properties.
pub(super) struct Scan {
    pub(super) file: PathBuf,
    /// The value type of the scan, one of [`KINDS`].
    pub(super) kind: &'static str,
    /// The picture that belongs to the scan.
    pub(super) picture: Option<PathBuf>,
    /// True if the camera of the scan is known. It is unknown if the camera file next to the scan belongs to another grid.
    has_camera: bool,
    /// True if the coordinates are in meters. The file format determines the unit, or meters are assumed if the scan would be too small in
    /// millimeters.
    pub(super) in_meters: bool,
    /// True if all points have z <= 0, as in range images whose y axis points up.
    pub(super) y_up: bool,
}

/// The scans and other files of a folder.
pub(super) struct Scans {
    pub(super) folder: PathBuf,
    /// The scans of one object, sorted by name. These are files whose names differ only in their numbers.
    pub(super) all: Vec<Scan>,
    /// Other files that can be read, with their value types.
    others: Vec<(PathBuf, &'static str)>,
    /// Messages about files that cannot be read although they have the extension of a scan or a picture.
    pub(super) unread: Vec<String>,
}

impl Scans {
    /// Finds the scans in a folder and its subfolders. `path` can also be a single scan file.
    ///
    /// # Errors
    /// A message if the path cannot be read.
    pub(super) fn find(path: &Path, catalog: &Catalog) -> Result<Self, String> {
        let is_folder = fs::metadata(path)
            .map_err(|error| format!("cannot read {}: {error}", path.for_display()))?
            .is_dir();
        let folder = if is_folder { path.to_owned() } else { path.with_file_name("") };
        let mut files = Vec::new();
        match is_folder {
            true => collect_files(path, 2, &mut files),
            false => {
                collect_files(&folder, 0, &mut files);
                files.retain(|file| file == path || !holds_a_scan(file, catalog));
            }
        }
        let (mut scans, mut pictures, mut unread) = (Vec::new(), Vec::new(), Vec::new());
        for file in files {
            match FileContent::read(&file, catalog) {
                Ok(Some(FileContent::Scan(scan))) => scans.push(scan),
                Ok(Some(FileContent::Picture(size))) => pictures.push((file, size)),
                Ok(None) => {}
                Err(why) => unread.push(why.replace('\n', " ")),
            }
        }
        let mut groups: BTreeMap<(usize, bool, String), Vec<Scan>> = BTreeMap::new();
        for (scan, size) in scans {
            let name = masked_name(&scan.file);
            let rank = KINDS.iter().position(|kind| *kind == scan.kind).unwrap_or_default();
            let picture = picture_of(&scan.file, size, &pictures);
            let scan = Scan { picture, ..scan };
            groups.entry((rank, scan.picture.is_none(), name)).or_default().push(scan);
        }
        let mut groups = Vec::from_iter(groups);
        // Sort groups of one value type: first those with pictures, then those with a camera, then by the number of scans and the size of
        // the file.
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

    /// Returns the message that a folder contains no scans that a recipe can use.
    pub(super) fn no_scan_message(&self) -> String {
        let folder = match self.folder.as_os_str().is_empty() {
            true => ".".into(),
            false => self.folder.display().to_string(),
        };
        let wanted = "a range image, a mesh or points";
        let nothing = match self.others.len() {
            0 => format!("no scan found in {folder}: expected {wanted}"),
            count => {
                let pictures = format_count(count, "picture");
                format!("no scan found in {folder} besides {pictures}: expected {wanted}")
            }
        };
        [nothing].iter().chain(&self.unread).map(String::as_str).collect::<Vec<_>>().join("\n")
    }

    /// Describes the number and the type of the scans, for a message.
    pub(super) fn kind_in_words(&self) -> String {
        match self.all.first() {
            None => "no scan".to_owned(),
            Some(scan) => {
                let count = self.all.len();
                let picture = if scan.picture.is_some() { " with a picture" } else { "" };
                format!("{count} {}{picture}", in_words(scan.kind, count))
            }
        }
    }

    /// Returns the files that can be read but are not in `used`. Each has the name of its value type for messages.
    pub(super) fn unused_files(&self, used: &[&Scan]) -> Vec<(String, &'static str)> {
        let left = self.all.iter().filter(|scan| used.iter().all(|it| it.file != scan.file));
        let left = left.map(|scan| (&scan.file, scan.kind));
        let others = self.others.iter().map(|(file, kind)| (file, *kind));
        left.chain(others).map(|(file, kind)| (file.display().to_string(), kind)).collect()
    }
}

/// Returns the name of a value type in messages, as a plural unless `count` is 1.
pub(super) fn in_words(kind: &str, count: usize) -> &'static str {
    match (kind, count) {
        ("RangeImage", 1) => "range image",
        ("RangeImage", _) => "range images",
        ("Mesh", 1) => "mesh",
        ("Mesh", _) => "meshes",
        _ => "files of points",
    }
}

/// Collects the files of a folder and its subfolders down to the depth `depth`. They are sorted by name; hidden files are left out.
fn collect_files(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) {
    let place = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let Ok(entries) = fs::read_dir(place) else { return };
    let mut names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    names.sort_by_cached_key(|name| natural_sort_key(&name.to_string_lossy()));
    names.retain(|name| !name.to_string_lossy().starts_with('.'));
    for path in names.into_iter().map(|name| folder.join(name)) {
        if files.len() < MAX_FILES && path.is_file() {
            files.push(path);
        } else if 0 < depth && path.is_dir() {
            collect_files(&path, depth - 1, files);
        }
    }
}

/// Returns a key that sorts numbers in names by their value, so that 2 comes before 10.
fn natural_sort_key(name: &str) -> String {
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

/// The content of a file: a scan or a picture.
enum FileContent {
    /// A scan. If it is a grid, also its width and height in pixels.
    Scan((Scan, Option<[usize; 2]>)),
    Picture([usize; 2]),
}

impl FileContent {
    /// Determines the content of a file by reading it. Returns `None` if it is neither a scan nor a picture.
    ///
    /// # Errors
    /// A message if the file cannot be read although it has the extension of a scan or a picture.
    fn read(file: &Path, catalog: &Catalog) -> Result<Option<Self>, String> {
        let readers = catalog.readers();
        let extension = extension(file);
        let (mut is_read, mut why) = (false, None);
        for kind in KINDS.into_iter().chain([Image::NAME]) {
            let Some(kind) = catalog
                .value_type(kind)
                .filter(|kind| readers.extensions(Some(kind.name)).contains(&&extension[..]))
            else {
                continue;
            };
            match readers.open(file, Some(kind)) {
                Ok((value, _)) => {
                    is_read = true;
                    let picture = value.get::<Image>();
                    let picture = picture.map(|it| Self::Picture([it.width(), it.height()]));
                    if let Some(found) = as_scan(file, &value).map(Self::Scan).or(picture) {
                        return Ok(Some(found));
                    }
                }
                // Keep the error of the type that was tried last. Points and pictures are tried last and require the least of a file, so
                // their error is the most useful one.
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
    matches!(FileContent::read(file, catalog), Ok(Some(FileContent::Scan(_))))
}

/// Describes a value as a scan. Returns `None` for a mesh without faces, and for a value without points.
fn as_scan(file: &Path, value: &AnyValue) -> Option<(Scan, Option<[usize; 2]>)> {
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
        // Survey formats are in meters. Otherwise assume meters if the diagonal is below 20: a scan of 20 mm is less likely than one of 20
        // m.
        in_meters: in_meters(file) || (high - low).norm() < 20.0,
        y_up: is_grid && high.z <= 0.0,
    };
    Some((scan, size))
}

/// Returns true if numbers in this file format are in meters.
pub(crate) fn in_meters(file: &Path) -> bool {
    ["las", "laz", "e57"].contains(&&extension(file)[..])
}

/// Returns the file name with `#` in place of each number. It is the same for all scans of one object.
fn masked_name(file: &Path) -> String {
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

/// Returns the picture that belongs to a scan, from the pictures in the same folder. The best one shares the longest beginning of its file
/// name with the scan. Then a picture with a word for color in its name is preferred, and then one with the size of the scan's grid.
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
