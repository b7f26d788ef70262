"""Commands for files of transforms: `record` writes one, `query` asks one, `replay` publishes one.

`playback` says which messages are played and when, `ingest` publishes them and knows when the
server has all of them. The formats are the library's, in `zenoh_tf.recordings`.
"""
