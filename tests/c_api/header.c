/* The C header alone, as C99 without extensions. */
#include "zenoh_tf/zenoh_tf.h"

ztf_options options = ZTF_OPTIONS_INIT;
ztf_lookup_options lookup_options = ZTF_LOOKUP_INIT;
int64_t no_stamp(void) { return ZTF_NO_STAMP; }
