//! The transform tree of this process, or that of a server on this host, by `libzenoh_tf`.
//!
//! `zenoh_tf.h` describes what each function does. Stamps are in nanoseconds; `None` is the latest
//! time that all links have. Errors carry the library's message.

mod ffi;

use std::ffi::{c_char, CStr, CString};
use std::{fmt, ptr, time::Duration};

/// A pose X_target_source, in metres and as a unit quaternion.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub qx: f64,
    pub qy: f64,
    pub qz: f64,
    pub qw: f64,
}

impl Default for Pose {
    fn default() -> Self {
        Pose { x: 0.0, y: 0.0, z: 0.0, qx: 0.0, qy: 0.0, qz: 0.0, qw: 1.0 }
    }
}

/// The pose of `child` in `parent` at a time.
#[derive(Clone, Copy, Debug)]
pub struct Transform<'a> {
    pub parent: &'a str,
    pub child: &'a str,
    pub stamp_ns: i64,
    pub pose: Pose,
}

/// What a lookup has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    pub pose: Pose,
    pub stamp_ns: i64,
    /// The longest gap between samples that was interpolated over.
    pub gap_ns: i64,
}

/// A name that was found once, by [`Tree::resolve`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Frame {
    tree: u64,
    id: u32,
    generation: u32,
}

/// Which time [`Tree::lookup_xact`] asks for.
#[derive(Clone, Copy, Debug)]
pub enum At {
    Stamp(i64),
    LatestCommon,
    /// The newest sample of every link.
    Latest,
}

/// `ztf_code`, by what a caller can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// A frame does not exist, also where the server has just started.
    Lookup,
    Connectivity,
    InvalidArgument,
    /// A link has no data for the time.
    Extrapolation,
    Gap,
    Limit,
    ReadOnly,
    ServerUnavailable,
    ServerBusy,
    StaleFrame,
    /// Any other `ztf_code`.
    Other(i32),
}

impl From<i32> for Code {
    fn from(code: i32) -> Self {
        match code {
            2 | 23 => Code::Lookup,
            3 => Code::Connectivity,
            4 => Code::InvalidArgument,
            6..=9 => Code::Extrapolation,
            11 => Code::Limit,
            13 => Code::ServerUnavailable,
            17 => Code::ServerBusy,
            20 => Code::ReadOnly,
            22 => Code::Gap,
            64 => Code::StaleFrame,
            other => Code::Other(other),
        }
    }
}

/// Why a call failed.
#[derive(Clone, Debug, PartialEq)]
pub struct Error {
    pub code: Code,
    pub message: String,
    /// The offending frame, or empty.
    pub frame: String,
    /// What the link can serve, of [`Code::Extrapolation`].
    pub oldest_stamp_ns: Option<i64>,
    pub newest_stamp_ns: Option<i64>,
}

impl fmt::Display for Error {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.message)
    }
}

impl std::error::Error for Error {}

pub type Result<T> = std::result::Result<T, Error>;

fn text(bytes: &[c_char]) -> String {
    // SAFETY: the library ends each text of an error with a zero byte.
    unsafe { CStr::from_ptr(bytes.as_ptr()) }.to_string_lossy().into_owned()
}

/// Calls the library with an error to fill, and returns that if the call failed.
fn call(function: impl FnOnce(*mut ffi::Error) -> i32) -> Result<()> {
    // SAFETY: all fields are numbers or texts, for which zero is a value.
    let mut error: ffi::Error = unsafe { std::mem::zeroed() };
    error.size = size_of::<ffi::Error>() as u32;
    let code = function(&mut error);
    if code == 0 {
        return Ok(());
    }
    let stamp = |stamp_ns| (stamp_ns != ffi::NO_STAMP).then_some(stamp_ns);
    Err(Error {
        code: code.into(),
        message: text(&error.message),
        frame: text(&error.frame),
        oldest_stamp_ns: stamp(error.oldest_stamp_ns),
        newest_stamp_ns: stamp(error.newest_stamp_ns),
    })
}

fn name(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error {
        code: Code::InvalidArgument,
        message: format!("the name {text:?} has a zero byte"),
        frame: String::new(),
        oldest_stamp_ns: None,
        newest_stamp_ns: None,
    })
}

fn nanoseconds(duration: Duration) -> i64 {
    duration.as_nanos().try_into().unwrap_or(i64::MAX)
}

/// The library's version.
pub fn version() -> &'static str {
    // SAFETY: a constant of the library.
    unsafe { CStr::from_ptr(ffi::ztf_version()) }.to_str().expect("a version is ASCII")
}

/// A tree, which ends with its value.
#[derive(Debug)]
pub struct Tree(*mut ffi::Tree);

// SAFETY: every function of the library but the end is for any thread at the same time.
unsafe impl Send for Tree {}
unsafe impl Sync for Tree {}

impl Tree {
    /// Makes a tree in this process, with the default options.
    pub fn create() -> Result<Tree> {
        let mut tree = ptr::null_mut();
        // SAFETY: NULL stands for the default options.
        call(|error| unsafe { ffi::ztf_tree_create(ptr::null(), &mut tree, error) })?;
        Ok(Tree(tree))
    }

    /// Maps a server's tree, to read it, and waits for the server until `timeout`. `folder` is the
    /// server's `--share-dir`.
    pub fn open(tree_name: &str, folder: Option<&str>, timeout: Duration) -> Result<Tree> {
        let tree_name = name(tree_name)?;
        let folder = folder.map(name).transpose()?;
        let folder = folder.as_ref().map_or(ptr::null(), |folder| folder.as_ptr());
        let mut tree = ptr::null_mut();
        // SAFETY: the texts live until the call has returned.
        call(|error| unsafe {
            ffi::ztf_tree_open(tree_name.as_ptr(), folder, nanoseconds(timeout), &mut tree, error)
        })?;
        Ok(Tree(tree))
    }

    /// Stores one transform. One that is too old is an error.
    pub fn set(&self, transform: &Transform, is_static: bool) -> Result<()> {
        self.set_xact(std::slice::from_ref(transform), is_static)
    }

    /// Stores all transforms at one instant, or none. One that is too old is an error.
    pub fn set_xact(&self, transforms: &[Transform], is_static: bool) -> Result<()> {
        let names = transforms
            .iter()
            .map(|transform| Ok((name(transform.parent)?, name(transform.child)?)))
            .collect::<Result<Vec<_>>>()?;
        let rows: Vec<_> = transforms
            .iter()
            .zip(&names)
            .map(|(transform, (parent, child))| ffi::Transform {
                parent: parent.as_ptr(),
                child: child.as_ptr(),
                stamp_ns: transform.stamp_ns,
                pose: transform.pose,
            })
            .collect();
        // SAFETY: `names` lives until the call has returned.
        call(|error| unsafe {
            let flags = i32::from(is_static);
            ffi::ztf_set_xact(self.0, rows.as_ptr(), rows.len(), ptr::null(), flags, error)
        })
    }

    /// Looks up X_target_source, and waits for it until `timeout`.
    pub fn lookup(
        &self,
        target: &str,
        source: &str,
        stamp_ns: Option<i64>,
        timeout: Duration,
    ) -> Result<Answer> {
        let (target, source) = (name(target)?, name(source)?);
        let options = ffi::LookupOptions {
            size: size_of::<ffi::LookupOptions>() as u32,
            timeout_ns: nanoseconds(timeout),
            max_gap_ns: -1,
        };
        let mut answer =
            ffi::Answer { size: size_of::<ffi::Answer>() as u32, ..Default::default() };
        let stamp_ns = stamp_ns.unwrap_or(ffi::NO_STAMP);
        // SAFETY: the names and both structures live until the call has returned.
        call(|error| unsafe {
            let (target, source) = (target.as_ptr(), source.as_ptr());
            ffi::ztf_lookup(self.0, target, source, stamp_ns, &options, &mut answer, error)
        })?;
        Ok(Answer { pose: answer.pose, stamp_ns: answer.stamp_ns, gap_ns: answer.gap_ns })
    }

    /// Finds a frame for [`Tree::lookup_xact`].
    pub fn resolve(&self, frame_name: &str) -> Result<Frame> {
        let frame_name = name(frame_name)?;
        let mut frame = Frame::default();
        // SAFETY: the name and the frame live until the call has returned.
        call(|error| unsafe { ffi::ztf_resolve(self.0, frame_name.as_ptr(), &mut frame, error) })?;
        Ok(frame)
    }

    /// Looks up N pairs (target, source) at one instant of the tree: each pose, and its stamp.
    pub fn lookup_xact<const N: usize>(
        &self,
        pairs: [(Frame, Frame); N],
        at: At,
    ) -> Result<[(Pose, i64); N]> {
        let (targets, sources) = (pairs.map(|pair| pair.0), pairs.map(|pair| pair.1));
        let (op, stamp_ns) = match at {
            At::Stamp(stamp_ns) => (0, stamp_ns),
            At::LatestCommon => (1, 0),
            At::Latest => (3, 0),
        };
        let mut poses = [Pose::default(); N];
        let mut stamps_ns = [0; N];
        // SAFETY: all arrays have N elements.
        call(|error| unsafe {
            let (poses, stamps_ns) = (poses.as_mut_ptr(), stamps_ns.as_mut_ptr());
            let (targets, sources) = (targets.as_ptr(), sources.as_ptr());
            ffi::ztf_lookup_xact(self.0, op, targets, sources, N, stamp_ns, poses, stamps_ns, error)
        })?;
        Ok(std::array::from_fn(|i| (poses[i], stamps_ns[i])))
    }
}

impl Drop for Tree {
    fn drop(&mut self) {
        // SAFETY: nothing borrows the tree any more.
        unsafe { ffi::ztf_tree_close(self.0) }
    }
}
