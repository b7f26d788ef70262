"""``python -m zenoh_tf_tools`` is the command ``zenoh-tf``."""

from zenoh_tf_tools.cli.main import run

if __name__ == "__main__":
    run()
