/* SPDX-License-Identifier: Apache-2.0 */
/* Reads what orbbuf-server writes to a pipe ([pipe] in its configuration), frame by frame, in C or
 * C++.
 *
 *   struct orbbuf_reader reader;
 *   struct orbbuf_image image;
 *   int got;
 *   orbbuf_reader_init(&reader, stdin);
 *   while ((got = orbbuf_read_pgm(&reader, &image)) == 1)
 *     track(image.t, image.pixels, image.width, image.height);
 *   if (got < 0) fprintf(stderr, "%s\n", reader.error);
 *   orbbuf_reader_free(&reader);
 *
 * One reader belongs to one thread at a time. Nothing here is kept between frames but the memory of
 * the largest one. */
#ifndef ORBBUF_PIPE_H
#define ORBBUF_PIPE_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Longer images than this, in bytes, are an error, not a reason to take memory. */
#ifndef ORBBUF_MAX_IMAGE
#define ORBBUF_MAX_IMAGE ((size_t)1 << 28)
#endif

struct orbbuf_reader {
  FILE* in;
  uint8_t* buffer;
  size_t capacity;
  const char* error; /* why the last call returned -1: a constant */
};

enum orbbuf_camera { ORBBUF_MONO = 0, ORBBUF_LEFT = 1, ORBBUF_RIGHT = 2 };

/* One image of the format "pgm". Of a stereo frame the left image comes first, then, with the same
 * seq and t, the right one. */
struct orbbuf_image {
  uint64_t seq; /* the frame's sequence number; one that is missing was dropped */
  double t;     /* capture time, seconds since the epoch, rounded: good to about 0.2 us */
  int64_t t_ns; /* the same in nanoseconds, exact */
  enum orbbuf_camera camera;
  uint32_t width, height; /* pixels */
  const uint8_t* pixels;  /* grayscale, row after row without gaps; valid until the next call */
};

/* `in` stays the caller's, and must be readable until the last call. */
static inline void orbbuf_reader_init(struct orbbuf_reader* reader, FILE* in) {
  memset(reader, 0, sizeof *reader);
  reader->in = in;
}

static inline void orbbuf_reader_free(struct orbbuf_reader* reader) {
  free(reader->buffer);
  reader->buffer = NULL;
  reader->capacity = 0;
}

static inline int orbbuf_fail_(struct orbbuf_reader* reader, const char* why) {
  reader->error = why;
  return -1;
}

/* At least `size` bytes in the buffer, keeping what is in it. */
static inline int orbbuf_grow_(struct orbbuf_reader* reader, size_t size) {
  uint8_t* grown;
  size_t capacity = reader->capacity ? reader->capacity : 65536;
  if (size <= reader->capacity) return 0;
  if (size > ORBBUF_MAX_IMAGE)
    return orbbuf_fail_(reader, "the image is larger than ORBBUF_MAX_IMAGE");
  while (capacity < size) capacity *= 2;
  grown = (uint8_t*)realloc(reader->buffer, capacity);
  if (!grown) return orbbuf_fail_(reader, "out of memory");
  reader->buffer = grown;
  reader->capacity = capacity;
  return 0;
}

/* "SECONDS.NANOSECONDS", as the server writes it: an optional minus and nine decimals. */
static inline int orbbuf_parse_time_(const char* text, struct orbbuf_image* image) {
  char* end = NULL;
  long long seconds, nanoseconds;
  const int is_negative = *text == '-';
  seconds = strtoll(text + is_negative, &end, 10);
  if (end == text + is_negative || *end != '.' || seconds > 9000000000LL) return -1;
  text = end + 1;
  nanoseconds = strtoll(text, &end, 10);
  if (end - text != 9 || *end != '\0' || nanoseconds < 0) return -1;
  image->t_ns = seconds * 1000000000LL + nanoseconds;
  if (is_negative) image->t_ns = -image->t_ns;
  image->t = (double)image->t_ns * 1e-9;
  return 0;
}

/* The next image of a pipe with format = "pgm". 1: there is one; 0: the stream has ended between
 * two images; -1: it is broken, see reader->error, and cannot be read on. Blocks until the image is
 * whole. */
static inline int orbbuf_read_pgm(struct orbbuf_reader* reader, struct orbbuf_image* image) {
  char line[128];
  unsigned long width = 0, height = 0;
  size_t bytes;
  int has_seq = 0, has_time = 0;
  memset(image, 0, sizeof *image);
  if (!fgets(line, sizeof line, reader->in)) {
    return ferror(reader->in) ? orbbuf_fail_(reader, "the pipe cannot be read") : 0;
  }
  if (strcmp(line, "P5\n") != 0)
    return orbbuf_fail_(reader, "this is not where a PGM image begins");
  for (;;) {
    if (!fgets(line, sizeof line, reader->in))
      return orbbuf_fail_(reader, "the stream ends in an image");
    if (line[strcspn(line, "\n")] != '\n')
      return orbbuf_fail_(reader, "a line of the head is too long");
    line[strcspn(line, "\n")] = '\0';
    if (line[0] != '#') break;
    if (strncmp(line, "# seq=", 6) == 0) {
      image->seq = strtoull(line + 6, NULL, 10);
      has_seq = 1;
    } else if (strncmp(line, "# t=", 4) == 0) {
      if (orbbuf_parse_time_(line + 4, image)) return orbbuf_fail_(reader, "the time is none");
      has_time = 1;
    } else if (strcmp(line, "# camera=left") == 0) {
      image->camera = ORBBUF_LEFT;
    } else if (strcmp(line, "# camera=right") == 0) {
      image->camera = ORBBUF_RIGHT;
    } /* other comments: later versions may have more to say */
  }
  if (!has_seq || !has_time) return orbbuf_fail_(reader, "the image has no seq or no t");
  if (sscanf(line, "%9lu %9lu", &width, &height) != 2 || !width || !height || width > 65535 ||
      height > 65535) {
    return orbbuf_fail_(reader, "the image has no size");
  }
  if (!fgets(line, sizeof line, reader->in) || strcmp(line, "255\n") != 0) {
    return orbbuf_fail_(reader, "the image has not 8 bits a pixel");
  }
  bytes = (size_t)width * height;
  if (orbbuf_grow_(reader, bytes)) return -1;
  if (fread(reader->buffer, 1, bytes, reader->in) != bytes) {
    return orbbuf_fail_(reader, "the stream ends in an image");
  }
  image->width = (uint32_t)width;
  image->height = (uint32_t)height;
  image->pixels = reader->buffer;
  return 1;
}

/* One more byte of the JPEG that has *size by now; -1 at the end of the stream and on errors. */
static inline int orbbuf_next_byte_(struct orbbuf_reader* reader, size_t* size) {
  const int byte = getc(reader->in);
  if (byte == EOF) return orbbuf_fail_(reader, "the stream ends in an image");
  if (orbbuf_grow_(reader, *size + 1)) return -1;
  reader->buffer[(*size)++] = (uint8_t)byte;
  return byte;
}

/* The next image of a pipe with format = "mjpeg": a whole JPEG file, in *jpeg until the next call,
 * of *size bytes. Returns as orbbuf_read_pgm does. Of a stereo frame the left image comes first. */
static inline int orbbuf_read_jpeg(struct orbbuf_reader* reader, const uint8_t** jpeg,
                                   size_t* size) {
  int byte = getc(reader->in), is_scan = 0;
  size_t left;
  *size = 0;
  if (byte == EOF) return ferror(reader->in) ? orbbuf_fail_(reader, "the pipe cannot be read") : 0;
  ungetc(byte, reader->in);
  if (orbbuf_next_byte_(reader, size) != 0xFF || orbbuf_next_byte_(reader, size) != 0xD8) {
    return orbbuf_fail_(reader, "this is not where a JPEG image begins");
  }
  /* From marker to marker: a thumbnail within a segment has an end of its own that is not the
   * image's. */
  for (;;) {
    do {
      if ((byte = orbbuf_next_byte_(reader, size)) < 0) return -1;
      if (byte != 0xFF && !is_scan) return orbbuf_fail_(reader, "a JPEG marker is missing");
    } while (byte != 0xFF);
    do {
      if ((byte = orbbuf_next_byte_(reader, size)) < 0) return -1;
    } while (byte == 0xFF);
    if (byte == 0xD9) break; /* the end of the image */
    if (byte == 0x00 || byte == 0x01 || (byte & 0xF8) == 0xD0)
      continue; /* in the scan; no length */
    left = 0;
    for (int i = 0; i < 2; ++i) {
      if ((byte = orbbuf_next_byte_(reader, size)) < 0) return -1;
      left = left << 8 | (size_t)byte;
    }
    if (left < 2) return orbbuf_fail_(reader, "a JPEG segment has no length");
    is_scan = reader->buffer[*size - 3] == 0xDA;
    left -= 2;
    if (orbbuf_grow_(reader, *size + left)) return -1;
    if (fread(reader->buffer + *size, 1, left, reader->in) != left) {
      return orbbuf_fail_(reader, "the stream ends in an image");
    }
    *size += left;
  }
  *jpeg = reader->buffer;
  return 1;
}

#ifdef __cplusplus
}
#endif
#endif
