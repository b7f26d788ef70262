//! Links `libzenoh_tf`: the file that `ZENOH_TF_LIBRARY` names, such as the output of
//! `python -m zenoh_tf.native --library`, else the one that the linker finds.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo:rerun-if-env-changed=ZENOH_TF_LIBRARY");
    let Some(path) = env::var_os("ZENOH_TF_LIBRARY").map(PathBuf::from) else {
        println!("cargo:rustc-link-lib=dylib=zenoh_tf");
        return;
    };
    let folder = path.parent().expect("ZENOH_TF_LIBRARY is a path").display();
    let name = path.file_name().expect("ZENOH_TF_LIBRARY names a file").to_string_lossy();
    println!("cargo:rustc-link-search=native={folder}");
    println!("cargo:rustc-link-lib=dylib:+verbatim={name}");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{folder}");
}
