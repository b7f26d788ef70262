"""Commands that ask and change a tree: `lookups`, `estimate`, `explain`, `follow`, `inspect`,
`doctor`; `write`, `static`.

In come names, stamps and poses as people write them; out goes text or JSON.
"""
