"""Text that people read or write: names of others, made safe to show, and the values of flags.

`escapes` shows what others have chosen, `times` stamps and ages. `time_flags` reads the times and
durations of flags, `flag_values` their numbers. `similar` finds the name that was probably meant,
`stamp_units` the unit that a stamp is in by mistake. `extras` says how an extra is installed.
Imports nothing of the library but `_core`.
"""

from zenoh_tf.text.escapes import cut as cut
from zenoh_tf.text.escapes import printable as printable
from zenoh_tf.text.escapes import quoted as quoted
