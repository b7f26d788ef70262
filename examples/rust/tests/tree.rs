use std::{thread, time::Duration};

use zenoh_tf::{At, Code, Pose, Transform, Tree};

const NO_WAIT: Duration = Duration::ZERO;

fn link<'a>(parent: &'a str, child: &'a str, stamp_ns: i64, x: f64) -> Transform<'a> {
    Transform { parent, child, stamp_ns, pose: Pose { x, ..Pose::default() } }
}

#[test]
fn a_lookup_interpolates() {
    let tree = Tree::create().unwrap();
    tree.set(&link("map", "base", 0, 0.0), false).unwrap();
    tree.set(&link("map", "base", 1000, 1.0), false).unwrap();
    let answer = tree.lookup("map", "base", Some(250), NO_WAIT).unwrap();
    assert_eq!((answer.pose.x, answer.stamp_ns), (0.25, 250));
    assert_eq!(tree.lookup("map", "base", None, NO_WAIT).unwrap().pose.x, 1.0);
    assert_eq!(tree.lookup("base", "map", None, NO_WAIT).unwrap().pose.x, -1.0);
}

#[test]
fn pairs_are_of_one_instant() {
    let tree = Tree::create().unwrap();
    tree.set_xact(&[link("base", "tool", 1000, 0.5), link("base", "target", 1000, 0.75)], false)
        .unwrap();
    let frame = |name| tree.resolve(name).unwrap();
    let pairs = [(frame("base"), frame("tool")), (frame("base"), frame("target"))];
    for at in [At::Stamp(1000), At::LatestCommon, At::Latest] {
        let [tool, target] = tree.lookup_xact(pairs, at).unwrap();
        assert_eq!((tool.0.x, target.0.x), (0.5, 0.75));
        assert_eq!((tool.1, target.1), (1000, 1000));
    }
    let stale = Tree::create().unwrap().lookup_xact(pairs, At::Latest).unwrap_err();
    assert_eq!(stale.code, Code::StaleFrame);
}

#[test]
fn errors_have_their_facts() {
    let tree = Tree::create().unwrap();
    tree.set(&link("map", "base", 1000, 0.0), false).unwrap();
    tree.set(&link("map", "base", 2000, 0.0), false).unwrap();
    let late = tree.lookup("map", "base", Some(3000), NO_WAIT).unwrap_err();
    assert_eq!((late.code, late.newest_stamp_ns), (Code::Extrapolation, Some(2000)));
    let unknown = tree.lookup("map", "bse", None, NO_WAIT).unwrap_err();
    assert_eq!((unknown.code, unknown.frame.as_str()), (Code::Lookup, "bse"));
    assert!(unknown.to_string().contains("bse"));
    assert_eq!(tree.resolve("a\0b").unwrap_err().code, Code::InvalidArgument);
    // A loop: nothing of it is stored.
    let both = [link("base", "tool", 3000, 0.0), link("tool", "map", 3000, 0.0)];
    assert_eq!(tree.set_xact(&both, false).unwrap_err().code, Code::InvalidArgument);
    assert_eq!(tree.resolve("tool").unwrap_err().code, Code::Lookup);
    let folder = std::env::temp_dir().join("zenoh-tf-without-a-server");
    let none = Tree::open("main", folder.to_str(), NO_WAIT).unwrap_err();
    assert_eq!(none.code, Code::ServerUnavailable);
}

#[test]
fn a_commit_of_another_thread_wakes_a_lookup() {
    let tree = Tree::create().unwrap();
    thread::scope(|scope| {
        let answer =
            scope.spawn(|| tree.lookup("map", "base", Some(1000), Duration::from_secs(60)));
        tree.set(&link("map", "base", 1000, 2.0), true).unwrap();
        assert_eq!(answer.join().unwrap().unwrap().pose.x, 2.0);
    });
}
