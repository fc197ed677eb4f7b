/* C face of the OpenEXR C++ library: what cgo can call. No exception leaves these functions.
 *
 * Functions that can fail return NULL on success, else a message that the caller frees with
 * free(). Handles are not safe for concurrent use; different handles are independent. */
#ifndef METROFARM_EXR_SHIM_H
#define METROFARM_EXR_SHIM_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* An image being written. */
typedef struct mf_exr_writer mf_exr_writer;

char* mf_exr_writer_new(int width, int height, mf_exr_writer** out);
void mf_exr_writer_free(mf_exr_writer* writer);

char* mf_exr_set_string(mf_exr_writer* writer, const char* name, const char* value);
char* mf_exr_set_int(mf_exr_writer* writer, const char* name, int value);
char* mf_exr_set_float(mf_exr_writer* writer, const char* name, float value);

/* Adds channel `name` of 32-bit floats, every third value (rows from the top); the values must stay
 * where they are until the file is encoded. */
char* mf_exr_add_channel(mf_exr_writer* writer, const char* name, const float* values);

/* Encodes rgb (3 floats per pixel, rows from the top) and the channels that were added as
 * ZIP-compressed scanlines. The file's bytes belong to the writer. */
char* mf_exr_encode(mf_exr_writer* writer, const float* rgb, int half, const char** bytes,
                    size_t* size);

/* An image that was read. */
typedef struct mf_exr_reader mf_exr_reader;

/* The bytes must stay valid until mf_exr_reader_free. */
char* mf_exr_reader_new(const char* bytes, size_t size, mf_exr_reader** out);
void mf_exr_reader_free(mf_exr_reader* reader);

void mf_exr_size(const mf_exr_reader* reader, int* width, int* height);

int mf_exr_channel_count(const mf_exr_reader* reader);
/* Name and type (1: half, 0: float) of channel index; the name belongs to the reader. */
const char* mf_exr_channel(const mf_exr_reader* reader, int index, int* half);
/* Reads one channel, converted to float, into width * height values. */
char* mf_exr_read_channel(mf_exr_reader* reader, const char* name, float* values);

int mf_exr_attribute_count(const mf_exr_reader* reader);
/* Name and value of attribute index (those of type string, int and float); both belong to the
 * reader. */
const char* mf_exr_attribute(const mf_exr_reader* reader, int index, const char** value);

#ifdef __cplusplus
}
#endif

#endif
