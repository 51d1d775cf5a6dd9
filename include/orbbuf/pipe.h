/* SPDX-License-Identifier: Apache-2.0 */
/* Reads what orbbuf-server writes to a SLAM program ([slam] in its configuration), image by image,
 * in C or C++.
 *
 *   struct orbbuf_reader reader;
 *   struct orbbuf_image image;
 *   int got;
 *   orbbuf_reader_init(&reader, stdin);
 *   while ((got = orbbuf_read(&reader, &image)) == 1)
 *     track(image.t, image.data, image.width, image.height);
 *   if (got < 0) fprintf(stderr, "%s\n", reader.error);
 *   orbbuf_reader_free(&reader);
 *
 * A program that is no child of the server reads a FIFO instead, with orbbuf_reader_follow(),
 * through the ends of sessions and of the server itself. No image of a session is given twice.
 *
 * One reader belongs to one thread at a time. Nothing here is kept between images but the memory of
 * the largest one. */
#ifndef ORBBUF_PIPE_H
#define ORBBUF_PIPE_H

#include <locale.h>
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

enum orbbuf_camera { ORBBUF_MONO = 0, ORBBUF_LEFT = 1, ORBBUF_RIGHT = 2 };
enum orbbuf_format { ORBBUF_PGM = 0, ORBBUF_JPEG = 1 };

/* One reading of an inertial sensor. */
struct orbbuf_sample {
  char sensor[65];               /* its name, for example imu0 */
  int64_t t_ns;                  /* nanoseconds since the epoch, on the clock of the images */
  double angular_velocity[3];    /* rad/s */
  double linear_acceleration[3]; /* m/s^2, gravity included */
};

/* One image. Of a stereo frame the left image comes first, then, with the same seq and t, the right
 * one. Pointers are valid until the next call. */
struct orbbuf_image {
  uint64_t seq; /* the frame's sequence number; one that is missing was dropped */
  double t;     /* capture time, seconds since the epoch, rounded: good to about 0.2 us */
  int64_t t_ns; /* the same in nanoseconds, exact */
  enum orbbuf_camera camera;
  char session[65]; /* one run of the robot's daemon; in each, seq begins with 0 */
  enum orbbuf_format format;
  uint32_t width, height; /* pixels; of a JPEG 0: its decoder tells */
  const uint8_t* data;    /* PGM: grayscale, row after row without gaps; JPEG: a whole JPEG file */
  size_t size;            /* of data, in bytes */
  uint64_t missed;        /* frames of the session that the stream has not, since the one before */
  double age; /* seconds from capture to the server's write, by the clocks of both machines; of a
                 replay, whose times are the recording's, 0 */
  uint8_t quality;      /* of the JPEG that the robot sent, 1 to 100; 0: not known */
  uint32_t whole_bytes; /* of the JPEG that the robot reduced it from, of a stereo frame of both
                           images together; 0: not reduced, or not known */
  /* All since the last image of this stream, up to this one, also across images that it has not.
   * Those of each sensor are in the order of time. Of a stereo frame the left image has them. */
  const struct orbbuf_sample* samples;
  size_t sample_count;
};

struct orbbuf_reader {
  FILE* in;
  const char* path;  /* of the FIFO that is followed, if one is */
  const char* error; /* why the last call returned -1: a constant */
  uint8_t* buffer;
  size_t capacity;
  struct orbbuf_sample* samples;
  size_t sample_count, sample_capacity;
  int has_last; /* the last image given, to know a repeat by */
  uint64_t last_seq;
  enum orbbuf_camera last_camera;
  char last_session[65];
};

static inline int orbbuf_fail_(struct orbbuf_reader* reader, const char* why) {
  reader->error = why;
  return -1;
}

/* `in` stays the caller's, and must be readable until the last call. */
static inline void orbbuf_reader_init(struct orbbuf_reader* reader, FILE* in) {
  memset(reader, 0, sizeof *reader);
  reader->in = in;
}

/* Opens the FIFO, waiting for a server that writes to it. */
static inline int orbbuf_open_(struct orbbuf_reader* reader) {
  if (reader->in) fclose(reader->in);
  reader->in = fopen(reader->path, "rb");
  if (!reader->in) return orbbuf_fail_(reader, "the FIFO cannot be opened");
  if (fseek(reader->in, 0, SEEK_CUR) != 0) return 0;
  fclose(reader->in);
  reader->in = NULL;
  return orbbuf_fail_(reader, "the path is no FIFO");
}

/* Follows the FIFO at `path`, which must stay valid and exist: when its writer goes, even in the
 * middle of an image, orbbuf_read() waits for the next one. 0, or -1 as orbbuf_read() does. */
static inline int orbbuf_reader_follow(struct orbbuf_reader* reader, const char* path) {
  orbbuf_reader_init(reader, NULL);
  reader->path = path;
  return orbbuf_open_(reader);
}

static inline void orbbuf_reader_free(struct orbbuf_reader* reader) {
  if (reader->path && reader->in) fclose(reader->in);
  free(reader->buffer);
  free(reader->samples);
  memset(reader, 0, sizeof *reader);
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

/* The number up to a comma or the end, with a decimal point in every locale. Its size, or 0. */
static inline size_t orbbuf_parse_number_(const char* text, double* value) {
  const size_t size = strcspn(text, ","), point = strcspn(text, ".,");
  const size_t after = point < size ? point + 1 : point;
  char number[64], *end;
  const int bytes =
      snprintf(number, sizeof number, "%.*s%s%.*s", (int)point, text,
               point < size ? localeconv()->decimal_point : "", (int)(size - after), text + after);
  *value = strtod(number, &end);
  return end != number && *end == '\0' && (size_t)bytes < sizeof number ? size : 0;
}

/* "SENSOR=TIME,WX,WY,WZ,AX,AY,AZ". */
static inline int orbbuf_parse_sample_(struct orbbuf_reader* reader, const char* line) {
  const size_t name = strcspn(line, "=");
  struct orbbuf_sample* sample;
  char* end = NULL;
  int i;
  if (reader->sample_count == reader->sample_capacity) {
    const size_t capacity = reader->sample_capacity ? 2 * reader->sample_capacity : 256;
    if (capacity > ORBBUF_MAX_IMAGE / sizeof *sample)
      return orbbuf_fail_(reader, "the image has too many samples");
    sample = (struct orbbuf_sample*)realloc(reader->samples, capacity * sizeof *sample);
    if (!sample) return orbbuf_fail_(reader, "out of memory");
    reader->samples = sample;
    reader->sample_capacity = capacity;
  }
  sample = &reader->samples[reader->sample_count];
  memset(sample, 0, sizeof *sample);
  if (name >= sizeof sample->sensor || line[name] != '=')
    return orbbuf_fail_(reader, "a sample has no sensor");
  memcpy(sample->sensor, line, name);
  sample->t_ns = strtoll(line + name + 1, &end, 10);
  for (i = 0; i < 6; ++i) {
    double* const number =
        i < 3 ? &sample->angular_velocity[i] : &sample->linear_acceleration[i - 3];
    const size_t size = *end == ',' ? orbbuf_parse_number_(end + 1, number) : 0;
    if (!size) return orbbuf_fail_(reader, "a sample has too few numbers");
    end += 1 + size;
  }
  ++reader->sample_count;
  return 0;
}

/* What one line tells of the image, bit by bit in *told: 1 its seq, 2 its t, 4 its session. */
static inline int orbbuf_parse_line_(struct orbbuf_reader* reader, struct orbbuf_image* image,
                                     const char* line, int* told) {
  if (strncmp(line, "seq=", 4) == 0) {
    image->seq = strtoull(line + 4, NULL, 10);
    *told |= 1;
  } else if (strncmp(line, "t=", 2) == 0) {
    if (orbbuf_parse_time_(line + 2, image)) return orbbuf_fail_(reader, "the time is none");
    *told |= 2;
  } else if (strncmp(line, "session=", 8) == 0 && strlen(line + 8) < sizeof image->session) {
    strcpy(image->session, line + 8);
    *told |= 4;
  } else if (strncmp(line, "missed=", 7) == 0) {
    image->missed = strtoull(line + 7, NULL, 10);
  } else if (strncmp(line, "age=", 4) == 0) {
    (void)orbbuf_parse_number_(line + 4, &image->age);
  } else if (strncmp(line, "quality=", 8) == 0) {
    image->quality = (uint8_t)strtoul(line + 8, NULL, 10);
  } else if (strncmp(line, "whole=", 6) == 0) {
    image->whole_bytes = (uint32_t)strtoul(line + 6, NULL, 10);
  } else if (strncmp(line, "imu", 3) == 0) {
    return orbbuf_parse_sample_(reader, line);
  } else if (strcmp(line, "camera=left") == 0) {
    image->camera = ORBBUF_LEFT;
  } else if (strcmp(line, "camera=right") == 0) {
    image->camera = ORBBUF_RIGHT;
  } /* others: later versions may have more to say */
  return 0;
}

static inline int orbbuf_check_told_(struct orbbuf_reader* reader, int told) {
  return told == 7 ? 0 : orbbuf_fail_(reader, "the image has no seq, no t or no session");
}

static inline int orbbuf_read_pgm_(struct orbbuf_reader* reader, struct orbbuf_image* image) {
  char line[320];
  unsigned long width = 0, height = 0;
  int told = 0;
  if (!fgets(line, sizeof line, reader->in) || strcmp(line, "P5\n") != 0)
    return orbbuf_fail_(reader, "this is not where an image begins");
  for (;;) {
    if (!fgets(line, sizeof line, reader->in))
      return orbbuf_fail_(reader, "the stream ends in an image");
    if (line[strcspn(line, "\n")] != '\n')
      return orbbuf_fail_(reader, "a line of the head is too long");
    line[strcspn(line, "\n")] = '\0';
    if (line[0] != '#') break;
    if (line[1] == ' ' && orbbuf_parse_line_(reader, image, line + 2, &told)) return -1;
  }
  if (orbbuf_check_told_(reader, told)) return -1;
  if (sscanf(line, "%9lu %9lu", &width, &height) != 2 || !width || !height || width > 65535 ||
      height > 65535) {
    return orbbuf_fail_(reader, "the image has no size");
  }
  if (!fgets(line, sizeof line, reader->in) || strcmp(line, "255\n") != 0)
    return orbbuf_fail_(reader, "the image has not 8 bits a pixel");
  image->format = ORBBUF_PGM;
  image->size = (size_t)width * height;
  if (orbbuf_grow_(reader, image->size)) return -1;
  if (fread(reader->buffer, 1, image->size, reader->in) != image->size)
    return orbbuf_fail_(reader, "the stream ends in an image");
  image->width = (uint32_t)width;
  image->height = (uint32_t)height;
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

/* The rest of the segment whose marker is the last byte by now; where it begins, in *begin. */
static inline int orbbuf_read_segment_(struct orbbuf_reader* reader, size_t* size, size_t* begin) {
  size_t left = 0;
  int i, byte;
  for (i = 0; i < 2; ++i) {
    if ((byte = orbbuf_next_byte_(reader, size)) < 0) return -1;
    left = left << 8 | (size_t)byte;
  }
  if (left < 2) return orbbuf_fail_(reader, "a JPEG segment has no length");
  left -= 2;
  *begin = *size;
  if (orbbuf_grow_(reader, *size + left)) return -1;
  if (fread(reader->buffer + *size, 1, left, reader->in) != left)
    return orbbuf_fail_(reader, "the stream ends in an image");
  *size += left;
  return 0;
}

/* The lines of the comment that ends with the last byte by now. */
static inline int orbbuf_parse_comment_(struct orbbuf_reader* reader, struct orbbuf_image* image,
                                        size_t begin, size_t size, int* told) {
  char line[320];
  size_t end;
  for (; begin < size; begin = end + 1) {
    for (end = begin; end < size && reader->buffer[end] != '\n';) ++end;
    if (end - begin >= sizeof line) return orbbuf_fail_(reader, "a line of the head is too long");
    memcpy(line, reader->buffer + begin, end - begin);
    line[end - begin] = '\0';
    if (orbbuf_parse_line_(reader, image, line, told)) return -1;
  }
  return 0;
}

/* The server's lines are the first segment, a comment; more samples are in those that follow and
 * begin with one. They stay in the file. */
static inline int orbbuf_read_comment_(struct orbbuf_reader* reader, struct orbbuf_image* image,
                                       size_t* size) {
  size_t begin = 0;
  int told = 0;
  if (orbbuf_next_byte_(reader, size) != 0xFF || orbbuf_next_byte_(reader, size) != 0xD8 ||
      orbbuf_next_byte_(reader, size) != 0xFF || orbbuf_next_byte_(reader, size) != 0xFE)
    return feof(reader->in) ? -1 : orbbuf_fail_(reader, "this is not where an image begins");
  if (orbbuf_read_segment_(reader, size, &begin)) return -1;
  if (orbbuf_parse_comment_(reader, image, begin, *size, &told)) return -1;
  return orbbuf_check_told_(reader, told);
}

/* From marker to marker: a thumbnail within a segment has an end of its own that is not the
 * image's. */
static inline int orbbuf_read_jpeg_(struct orbbuf_reader* reader, struct orbbuf_image* image) {
  int byte, is_scan = 0, is_head = 1, told = 0;
  size_t size = 0, begin;
  if (orbbuf_read_comment_(reader, image, &size)) return -1;
  for (;;) {
    do {
      if ((byte = orbbuf_next_byte_(reader, &size)) < 0) return -1;
      if (byte != 0xFF && !is_scan) return orbbuf_fail_(reader, "a JPEG marker is missing");
    } while (byte != 0xFF);
    do {
      if ((byte = orbbuf_next_byte_(reader, &size)) < 0) return -1;
    } while (byte == 0xFF);
    if (byte == 0xD9) break; /* the end of the image */
    if (byte == 0x00 || byte == 0x01 || (byte & 0xF8) == 0xD0)
      continue; /* in the scan; no length */
    is_scan = byte == 0xDA;
    if (orbbuf_read_segment_(reader, &size, &begin)) return -1;
    is_head = is_head && byte == 0xFE && size - begin > 3 &&
              memcmp(reader->buffer + begin, "imu", 3) == 0;
    if (is_head && orbbuf_parse_comment_(reader, image, begin, size, &told)) return -1;
  }
  image->format = ORBBUF_JPEG;
  image->size = size;
  return 1;
}

/* 1 if this image, or a later one of its session, was given already; else it is the last one now.
 */
static inline int orbbuf_is_repeat_(struct orbbuf_reader* reader,
                                    const struct orbbuf_image* image) {
  if (reader->has_last && strcmp(reader->last_session, image->session) == 0) {
    if (image->seq < reader->last_seq) return 1;
    if (image->seq == reader->last_seq && image->camera <= reader->last_camera) return 1;
  }
  reader->has_last = 1;
  reader->last_seq = image->seq;
  reader->last_camera = image->camera;
  memcpy(reader->last_session, image->session, sizeof reader->last_session);
  return 0;
}

/* The next image, of either format. 1: there is one; 0: the stream has ended between two images;
 * -1: it is broken, see reader->error, and cannot be read on. Blocks until the image is whole. Of a
 * FIFO that is followed there is no end. */
static inline int orbbuf_read(struct orbbuf_reader* reader, struct orbbuf_image* image) {
  int first, got;
  for (;;) {
    memset(image, 0, sizeof *image);
    reader->sample_count = 0;
    if (!reader->in) return -1;
    first = getc(reader->in);
    if (first == EOF) {
      got = ferror(reader->in) ? orbbuf_fail_(reader, "the pipe cannot be read") : 0;
    } else {
      ungetc(first, reader->in);
      got = first == 'P' ? orbbuf_read_pgm_(reader, image) : orbbuf_read_jpeg_(reader, image);
    }
    if (got == 1 && orbbuf_is_repeat_(reader, image)) continue;
    image->data = reader->buffer;
    image->samples = reader->samples;
    image->sample_count = reader->sample_count;
    if (got == 1 || !reader->path || !feof(reader->in)) return got;
    if (orbbuf_open_(reader)) return -1;
  }
}

#ifdef __cplusplus
}
#endif
#endif
