package preview_test

import (
	"bytes"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/preview"
)

func TestFloatMapsBeginWithTheLowestRow(t *testing.T) {
	var buffer bytes.Buffer
	image := job.Image{Width: 1, Height: 2, RGB: []float32{0, 0, 0, 1, 2, -2}}
	if err := preview.WritePFM(&buffer, image); err != nil {
		t.Fatal(err)
	}
	want := "PF\n1 2\n-1.0\n" + "\x00\x00\x80\x3f\x00\x00\x00\x40\x00\x00\x00\xc0" + strings.Repeat("\x00", 12)
	if buffer.String() != want {
		t.Errorf("%q, want %q", buffer.String(), want)
	}
	image.RGB = image.RGB[1:]
	if err := preview.WritePFM(&buffer, image); err == nil {
		t.Error("an image that lacks values is written")
	}
}

func TestShrinkTakesMeans(t *testing.T) {
	image := gray(5, 2, 1)
	image.RGB[0] = 3
	small := preview.Shrink(image, 2)
	if small.Width != 2 || small.Height != 1 {
		t.Fatalf("%d x %d", small.Width, small.Height)
	}
	// The left pixel is the mean of 2 x 2: one of 3, three of 1. Its green has ones only.
	if small.RGB[0] != 1.5 || small.RGB[1] != 1 || small.RGB[3] != 1 {
		t.Errorf("%v", small.RGB)
	}
	if same := preview.Shrink(image, 5); same.Width != 5 {
		t.Errorf("a small image becomes %d wide", same.Width)
	}
}
