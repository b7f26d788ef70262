//! The parts of `zenoh_tf.h` that the crate uses, as C declares them.

use std::ffi::{c_char, c_void};

use crate::{Frame, Pose};

pub const NO_STAMP: i64 = i64::MIN;

#[repr(C)]
pub struct Transform {
    pub parent: *const c_char,
    pub child: *const c_char,
    pub stamp_ns: i64,
    pub pose: Pose,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct Answer {
    pub size: u32,
    pub pose: Pose,
    pub stamp_ns: i64,
    pub newest_stamp_ns: i64,
    pub gap_ns: i64,
}

#[repr(C)]
pub struct Error {
    pub size: u32,
    pub code: i32,
    pub stamp_ns: i64,
    pub oldest_stamp_ns: i64,
    pub newest_stamp_ns: i64,
    pub gap_ns: i64,
    pub limit: i64,
    pub value: i64,
    pub retry_after_s: f64,
    pub message: [c_char; 1024],
    pub field: [c_char; 64],
    pub target_frame: [c_char; 256],
    pub source_frame: [c_char; 256],
    pub frame: [c_char; 256],
    pub parent_frame: [c_char; 256],
    pub target_root: [c_char; 256],
    pub source_root: [c_char; 256],
}

#[repr(C)]
pub struct LookupOptions {
    pub size: u32,
    pub timeout_ns: i64,
    pub max_gap_ns: i64,
}

pub type Tree = c_void;

extern "C" {
    pub fn ztf_version() -> *const c_char;
    pub fn ztf_tree_create(options: *const c_void, tree: *mut *mut Tree, error: *mut Error) -> i32;
    pub fn ztf_tree_open(
        name: *const c_char,
        folder: *const c_char,
        timeout_ns: i64,
        tree: *mut *mut Tree,
        error: *mut Error,
    ) -> i32;
    pub fn ztf_tree_close(tree: *mut Tree);
    pub fn ztf_set_xact(
        tree: *mut Tree,
        transforms: *const Transform,
        count: usize,
        authority: *const c_char,
        flags: i32,
        error: *mut Error,
    ) -> i32;
    pub fn ztf_lookup(
        tree: *const Tree,
        target: *const c_char,
        source: *const c_char,
        stamp_ns: i64,
        options: *const LookupOptions,
        answer: *mut Answer,
        error: *mut Error,
    ) -> i32;
    pub fn ztf_resolve(
        tree: *const Tree,
        name: *const c_char,
        frame: *mut Frame,
        error: *mut Error,
    ) -> i32;
    pub fn ztf_lookup_xact(
        tree: *const Tree,
        op: i32,
        targets: *const Frame,
        sources: *const Frame,
        count: usize,
        stamp_ns: i64,
        poses: *mut Pose,
        stamps_ns: *mut i64,
        error: *mut Error,
    ) -> i32;
}
