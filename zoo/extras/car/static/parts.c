/* The parts of an exported file that are the same for every network; `c_file.py` picks them. */

/* part: convert plain */
/* Write a pixel, RGB, in the view's colours: RGB or BGR. */
static void convert(const uint8_t *rgb, uint8_t *out)
{
    out[0] = rgb[RED];
    out[1] = rgb[GREEN];
    out[2] = rgb[BLUE];
}

/* part: convert gray */
/* Write a pixel, RGB, as gray. */
static void convert(const uint8_t *rgb, uint8_t *out)
{
    int32_t gray = INT32_C(9798) * rgb[RED] + INT32_C(19235) * rgb[GREEN] + INT32_C(3735) * rgb[BLUE];
    out[0] = (uint8_t)((gray + 16384) >> 15);
}

/* part: convert yuv */
/* Return a colour difference, shifted to 0..255. */
static uint8_t difference(int32_t value)
{
    int32_t shifted = (value + (INT32_C(128) << 14) + 8192) >> 14;
    return (uint8_t)(shifted < 0 ? 0 : shifted > 255 ? 255 : shifted);
}

/* Write a pixel, RGB, as YUV. */
static void convert(const uint8_t *rgb, uint8_t *out)
{
    int32_t red = rgb[RED], green = rgb[GREEN], blue = rgb[BLUE];
    int32_t y = (INT32_C(4899) * red + INT32_C(9617) * green + INT32_C(1868) * blue + 8192) >> 14;
    out[0] = (uint8_t)y;
    out[1] = difference((blue - y) * INT32_C(8061));
    out[2] = difference((red - y) * INT32_C(14369));
}

/* part: convert hsv */
/* Write a pixel, RGB, as HSV: hue 0..179, saturation and value 0..255; or its saturation alone. */
static void convert(const uint8_t *rgb, uint8_t *out)
{
    int32_t red = rgb[RED], green = rgb[GREEN], blue = rgb[BLUE], range;
    int32_t most = red > green ? red : green, least = red < green ? red : green;
    most = blue > most ? blue : most;
    least = blue < least ? blue : least;
    range = most - least;
    /* 4096 * 255 / most, rounded; the product with the range has 12 binary places. */
    int32_t saturation = most ? (range * ((INT32_C(2088960) + most) / (2 * most)) + 2048) >> 12 : 0;
    if (CHANNELS == 1) {
        out[0] = (uint8_t)saturation;
    } else {
        int32_t hue = green - blue;
        if (most != red) {
            hue = most == green ? blue - red + 2 * range : red - green + 4 * range;
        }
        /* 4096 * 30 / range, rounded. */
        hue = range ? (hue * ((INT32_C(245760) + range) / (2 * range)) + 2048) >> 12 : 0;
        out[0] = (uint8_t)(hue < 0 ? hue + 180 : hue);
        out[CHANNELS - 2] = (uint8_t)saturation;
        out[CHANNELS - 1] = (uint8_t)most;
    }
}

/* part: sample converted */
/* Write a pixel of the cropped frame in the view's colours. */
static void sample(const uint8_t *rgb, int y, int x, uint8_t *pixel)
{
    convert(rgb + 3 * ((TOP + y) * FRAME_WIDTH + x), pixel);
}

/* part: sample raw */
/* Write a pixel of the cropped frame; it is resized before its colours are converted. */
static void sample(const uint8_t *rgb, int y, int x, uint8_t *pixel)
{
    for (int c = 0; c < SAMPLED; c++) {
        pixel[c] = rgb[3 * ((TOP + y) * FRAME_WIDTH + x) + c];
    }
}

/* part: sample blurred */
/* Return a place of -1..size as one within the image: that of the mirror image at its edge. */
static int mirrored(int place, int size)
{
    int inside = place < 0 ? -place : place >= size ? 2 * size - 2 - place : place;
    return size == 1 ? 0 : inside;
}

/* Write a pixel of the cropped frame in the view's colours, blurred by 3 x 3 pixels. */
static void sample(const uint8_t *rgb, int y, int x, uint8_t *pixel)
{
    int32_t sum[SAMPLED] = {0};
    for (int dy = -1; dy <= 1; dy++) {
        for (int dx = -1; dx <= 1; dx++) {
            int row = TOP + mirrored(y + dy, CROPPED_HEIGHT), column = mirrored(x + dx, FRAME_WIDTH);
            convert(rgb + 3 * (row * FRAME_WIDTH + column), pixel);
            for (int c = 0; c < SAMPLED; c++) {
                sum[c] += (dy ? 1 : 2) * (dx ? 1 : 2) * pixel[c];
            }
        }
    }
    for (int c = 0; c < SAMPLED; c++) {
        pixel[c] = (uint8_t)((sum[c] + 8) >> 4);
    }
}

/* part: store plain */
/* Write a pixel of the view as the network's input. */
static void store(const uint8_t *pixel, float *out)
{
    for (int c = 0; c < CHANNELS; c++) {
        out[c] = (float)pixel[c];
    }
}

/* part: store converted */
/* Write a resized pixel, RGB, as the network's input. */
static void store(const uint8_t *pixel, float *out)
{
    uint8_t seen[CHANNELS];
    convert(pixel, seen);
    for (int c = 0; c < CHANNELS; c++) {
        out[c] = (float)seen[c];
    }
}

/* part: view same */
/* Write the view of a frame: its rows within the crop. */
static void view(const uint8_t *rgb, float *out)
{
    uint8_t pixel[SAMPLED];
    for (int y = 0; y < VIEW_HEIGHT; y++) {
        for (int x = 0; x < VIEW_WIDTH; x++, out += CHANNELS) {
            sample(rgb, y, x, pixel);
            store(pixel, out);
        }
    }
}

/* part: view area */
/* Return a sum of pixels as one pixel, rounded as OpenCV rounds it. */
static uint8_t nearest(float value)
{
    int whole = (int)value;
    float rest = value - (float)whole;
    whole += rest > 0.5f || (rest == 0.5f && (HALF_UP || whole % 2));
    return (uint8_t)(whole > 255 ? 255 : whole);
}

/* Write the view of a frame, resized by area: OpenCV's sums, in its order. */
static void view(const uint8_t *rgb, float *out)
{
    uint8_t pixel[SAMPLED];
    for (int y = 0; y < VIEW_HEIGHT; y++) {
        for (int x = 0; x < VIEW_WIDTH; x++, out += CHANNELS) {
            float sum[SAMPLED] = {0};
            for (int j = row_start[y]; j < row_start[y + 1]; j++) {
                float line[SAMPLED] = {0};
                for (int i = column_start[x]; i < column_start[x + 1]; i++) {
                    sample(rgb, row_at[j], column_at[i], pixel);
                    for (int c = 0; c < SAMPLED; c++) {
                        float part = (float)pixel[c] * column_weight[i];
                        line[c] = line[c] + part;
                    }
                }
                for (int c = 0; c < SAMPLED; c++) {
                    float part = line[c] * row_weight[j];
                    sum[c] = sum[c] + part;
                }
            }
            for (int c = 0; c < SAMPLED; c++) {
                float mean = sum[c] * AREA_SCALE;
                pixel[c] = nearest(mean);
            }
            store(pixel, out);
        }
    }
}

/* part: view linear */
/* Write the view of a frame, resized bilinearly: OpenCV's numbers of 11 binary places. */
static void view(const uint8_t *rgb, float *out)
{
    uint8_t pixel[SAMPLED];
    for (int y = 0; y < VIEW_HEIGHT; y++) {
        for (int x = 0; x < VIEW_WIDTH; x++, out += CHANNELS) {
            int32_t sum[SAMPLED] = {0};
            for (int j = 2 * y; j < 2 * y + 2; j++) {
                int32_t line[SAMPLED] = {0};
                for (int i = 2 * x; i < 2 * x + 2; i++) {
                    sample(rgb, row_at[j], column_at[i], pixel);
                    for (int c = 0; c < SAMPLED; c++) {
                        line[c] += (int32_t)pixel[c] * column_weight[i];
                    }
                }
                for (int c = 0; c < SAMPLED; c++) {
                    sum[c] += ((line[c] >> 4) * row_weight[j]) >> 16;
                }
            }
            for (int c = 0; c < SAMPLED; c++) {
                pixel[c] = (uint8_t)((sum[c] + 2) >> 2);
            }
            store(pixel, out);
        }
    }
}

/* part: exponential */
/* Return e to the power of a number, within 2e-7 of it; no number of a network overflows it. */
static float exponential(float value)
{
    float bounded = value < -87.0f ? -87.0f : value > 88.0f ? 88.0f : value;
    float turns = bounded * 1.44269504f;
    int32_t power = (int32_t)(turns < 0.0f ? turns - 0.5f : turns + 0.5f);
    float whole = (float)power, sum = 1.0f / 5040.0f;
    float rest = bounded - whole * 0.693145752f; /* ln 2 in two parts, the first one exact */
    rest = rest - whole * 1.42860677e-6f;
    static const float factors[7] = {1.0f / 720.0f, 1.0f / 120.0f, 1.0f / 24.0f,
                                     1.0f / 6.0f, 0.5f, 1.0f, 1.0f};
    for (int i = 0; i < 7; i++) {
        sum = sum * rest + factors[i];
    }
    union { uint32_t bits; float value; } scale;
    scale.bits = (uint32_t)(power + 127) << 23;
    return sum * scale.value;
}

/* part: type float */
typedef float weight;

/* part: type int8 */
typedef int8_t weight;

/* part: type window */
/* A window that moves over an image, and its steps in the image's memory, in numbers. */
typedef struct {
    int channels, height, width, channel_step, row_step, column_step;
    int outputs, rows, columns, kernel_height, kernel_width;
    int stride_y, stride_x, dilation_y, dilation_x, top, left;
} window;

/* part: under */
/* Return the pixel under a place of a window's kernel, or a null pointer outside the image. */
static const float *under(const window *of, int place, int kernel, const float *in)
{
    int y = place / of->columns * of->stride_y - of->top;
    int x = place % of->columns * of->stride_x - of->left;
    y += kernel / of->kernel_width * of->dilation_y;
    x += kernel % of->kernel_width * of->dilation_x;
    if (y < 0 || y >= of->height || x < 0 || x >= of->width) {
        return 0;
    }
    return in + y * of->row_step + x * of->column_step;
}

/* part: convolve */
/* Write a convolution; a dense layer is one over an image of a single pixel.
   LANES outputs are summed at a time, which a compiler keeps in registers. */
static void convolve(const window *of, const weight *weights, const float *scale,
                     const float *bias, const float *in, float *out)
{
    const int count = of->outputs, size = of->kernel_height * of->kernel_width;
    for (int place = 0; place < of->rows * of->columns; place++, out += count) {
        const weight *at = weights;
        for (int first = 0; first < count; first += LANES) {
            float sum[LANES] = {0};
            for (int j = 0; j < size; j++) {
                const float *pixel = under(of, place, j, in);
                for (int c = 0; c < of->channels; c++, at += LANES) {
                    const float value = pixel ? pixel[c * of->channel_step] : 0.0f;
                    for (int o = 0; o < LANES; o++) {
                        sum[o] += value * (float)at[o];
                    }
                }
            }
            for (int o = first; o < count && o < first + LANES; o++) {
                float total = scale ? sum[o - first] * scale[o] : sum[o - first];
                out[o] = total + bias[o];
            }
        }
    }
}

/* part: pool_max */
/* Write the largest value in each window. */
static void pool_max(const window *of, const float *restrict in, float *restrict out)
{
    for (int place = 0; place < of->rows * of->columns; place++, out += of->channels) {
        for (int c = 0; c < of->channels; c++) {
            float most = -3.4e38f;
            for (int j = 0; j < of->kernel_height * of->kernel_width; j++) {
                const float *pixel = under(of, place, j, in);
                if (pixel && pixel[c * of->channel_step] > most) {
                    most = pixel[c * of->channel_step];
                }
            }
            out[c] = most;
        }
    }
}

/* part: pool_mean */
/* Write the mean of each window. */
static void pool_mean(const window *of, const float *restrict in, float *restrict out)
{
    const int size = of->kernel_height * of->kernel_width;
    for (int place = 0; place < of->rows * of->columns; place++, out += of->channels) {
        for (int c = 0; c < of->channels; c++) {
            float sum = 0.0f;
            for (int j = 0; j < size; j++) {
                const float *pixel = under(of, place, j, in);
                sum += pixel ? pixel[c * of->channel_step] : 0.0f;
            }
            out[c] = sum / (float)size;
        }
    }
}

/* part: copy */
/* Copy values that lie some steps apart. */
static void copy(const float *in, int step, int count, float *out)
{
    for (int i = 0; i < count; i++) {
        out[i] = in[i * step];
    }
}

/* part: end */
/* Return a network's output, limited to -1..1. */
static float clipped(float value)
{
    return value < -1.0f ? -1.0f : value > 1.0f ? 1.0f : value;
}

/* Return NaN; the macro for it would need math.h. */
static float not_a_number(void)
{
    union { uint32_t bits; float value; } nan;
    nan.bits = UINT32_C(0x7fc00000);
    return nan.value;
}

/* part: header */
/*
$card
 */
#ifndef ${UPPER}_H
#define ${UPPER}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The size of a frame, in pixels. */
#define ${UPPER}_WIDTH $columns
#define ${UPPER}_HEIGHT $rows

/* Return the steering for a frame, from -1 (left) to 1 (right).
 *
 * rgb: the frame, $rows rows of $columns pixels from the top left, each red, green and blue, 0..255
 * width, height: size of the frame
 * speed_mph: miles per hour; $speed
 *
 * Returns NaN, which is not equal to itself, if rgb is null, the frame has another size, or the
 * network takes the speed and that is NaN.
 * Values between the layers are static: a second call must not begin before the first one returns.
 */
float $name(const uint8_t *rgb, int width, int height, float speed_mph);

THROTTLE#ifdef __cplusplus
}
#endif

#endif

/* part: header throttle */
/* Return the throttle that belongs to the last steering, from -1 (brake) to 1, or NaN. */
float ${name}_throttle(void);
