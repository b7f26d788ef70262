"""Calls as requests: what a client asks for, and what the reply means. No file here does I/O.

In come the arguments of the API; out goes a `Request`, which has a message's body and a function
that makes the result, or the error, from the reply. `lookups`, `writes` and `info` have a function
for each method of the client, `batch_operations` and `batch` the same for many operations in one
message. `Receipt` and `Handle` are results that users keep.

It may import only the library, `zenoh_tf`.
"""
