"""``python -m zenoh_tf_client`` is the command ``zenoh-tf``."""

from zenoh_tf_client.cli.main import run

if __name__ == "__main__":
    run()
