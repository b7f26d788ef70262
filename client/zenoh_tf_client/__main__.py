"""``python -m zenoh_tf_client``: the same as the command ``zenoh-tf``."""

from zenoh_tf_client.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
