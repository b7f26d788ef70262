"""``python -m zenoh_tf_server``"""

from .main import main

if __name__ == "__main__":
    raise SystemExit(main())
