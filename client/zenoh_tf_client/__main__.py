"""``python -m zenoh_tf_client``: the same as the command ``zenoh-tf``."""

from zenoh_tf_client.cli.main import run

if __name__ == "__main__":
    run()
