"""An asyncio client: many lookups at once travel in one message."""

import argparse
import asyncio

import uvloop

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import AsyncTransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()


async def main() -> None:
    async with await AsyncTransformClient.connect(args.connect) as tf:
        names = [f"wheel{number}" for number in range(4)]
        waiting = asyncio.create_task(tf.lookup_transform("base", "wheel3", timeout_s=5.0))
        for x, name in enumerate(names):
            X_base_wheel = Transform(translation=(float(x), 0.0, 0.0))
            await tf.set_transform(StampedTransform("base", name, 1, X_base_wheel))
        wheels = await asyncio.gather(*(tf.lookup_transform("base", name) for name in names))
        print("wheels:", *(wheel.transform.translation[0] for wheel in wheels))
        print("the last:", (await waiting).transform.translation[0])


uvloop.run(main())
