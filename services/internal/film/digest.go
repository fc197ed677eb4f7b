package film

// The linear digest of a batch: see BatchHeader.digest in task.proto.

// mix is the finalizer of SplitMix64.
func mix(x uint64) uint64 {
	z := (x + 1) * 0x9e3779b97f4a7c15
	z = (z ^ z>>30) * 0xbf58476d1ce4e5b9
	z = (z ^ z>>27) * 0x94d049bb133111eb
	return z ^ z>>31
}

func pixelHash(i uint64) uint64 { return mix(i) | 1 }

func planeHash(plane, channel int) uint64 {
	return mix(1<<48+3*uint64(plane)+uint64(channel)) | 1
}

// tileDigest is the tile's part of the batch digest.
func (s Shape) tileDigest(a Address, values []int64) uint64 {
	r := s.region(a)
	plane, base, stride := a.Plane, uint64(a.Y*TileSize*s.Width+a.X*TileSize), uint64(s.Width)
	if a.Low {
		plane, base, stride = 128+a.Plane, 1<<32, LowSize
	}
	var sums [Channels]uint64
	area := r.side * r.side
	for row := range r.height {
		for column := range r.width {
			at := row*r.side + column
			red, green, blue := values[at], values[area+at], values[2*area+at]
			if red|green|blue == 0 {
				continue // most values of a batch
			}
			hash := pixelHash(base + uint64(row)*stride + uint64(column))
			sums[0] += uint64(red) * hash
			sums[1] += uint64(green) * hash
			sums[2] += uint64(blue) * hash
		}
	}
	var digest uint64
	for c, sum := range sums {
		digest += sum * planeHash(plane, c)
	}
	return digest
}

// SplatDigest is what adding v at one value contributes to a digest: what a worker sums while it
// renders.
func (s Shape) SplatDigest(low bool, plane, pixel, channel int, v int64) uint64 {
	if low {
		return uint64(v) * pixelHash(1<<32+uint64(pixel)) * planeHash(128+plane, channel)
	}
	return uint64(v) * pixelHash(uint64(pixel)) * planeHash(plane, channel)
}
