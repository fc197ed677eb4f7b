package s3

import (
	"strings"
	"testing"
)

func TestLocations(t *testing.T) {
	for location, want := range map[string][2]string{
		"s3://bucket": {"bucket", ""}, "s3://bucket/": {"bucket", ""}, "s3://my.bucket-1/a/b_c/": {"my.bucket-1", "a/b_c"},
	} {
		bucket, prefix, err := ParseLocation(location)
		if err != nil || bucket != want[0] || prefix != want[1] {
			t.Errorf("%s: %q %q %v", location, bucket, prefix, err)
		}
	}
	for _, location := range []string{
		"bucket", "s3:/bucket", "s3://", "s3://B", "s3://Bucket/x", "s3://bucket//x", "s3://bucket/../x",
		"s3://bucket/a//b", "s3://bucket/a b", "s3://key:secret@bucket",
	} {
		if _, _, err := ParseLocation(location); err == nil {
			t.Errorf("%s was accepted", location)
		}
	}
}

func TestEnvironment(t *testing.T) {
	keys := map[string]string{"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}
	with := func(more ...string) map[string]string {
		all := map[string]string{}
		for name, value := range keys {
			all[name] = value
		}
		for i := 0; i < len(more); i += 2 {
			all[more[i]] = more[i+1]
		}
		return all
	}
	full := Credentials{AccessKey: "key", SecretKey: "secret"}
	for name, c := range map[string]struct {
		environment map[string]string
		set, want   Options
		problem     string
	}{
		"keys": {environment: keys, want: Options{Credentials: full}},
		"token": {
			environment: with("AWS_SESSION_TOKEN", "token"),
			want:        Options{Credentials: Credentials{AccessKey: "key", SecretKey: "secret", SessionToken: "token"}},
		},
		"places": {
			environment: with("AWS_ENDPOINT_URL", "http://a", "AWS_ENDPOINT_URL_S3", "http://b", "AWS_DEFAULT_REGION", "r"),
			want:        Options{Credentials: full, Endpoint: "http://b", Region: "r"},
		},
		"flags first": {
			environment: with("AWS_ENDPOINT_URL", "http://a", "AWS_REGION", "r"), set: Options{Endpoint: "http://c", Region: "q"},
			want: Options{Credentials: full, Endpoint: "http://c", Region: "q"},
		},
		"a pod's": {
			environment: map[string]string{"AWS_WEB_IDENTITY_TOKEN_FILE": "/token"},
			want:        Options{Credentials: Credentials{Ambient: true}},
		},
		"none": {problem: "AWS_ACCESS_KEY_ID"},
		"half": {environment: map[string]string{"AWS_ACCESS_KEY_ID": "key"}, problem: "AWS_SECRET_ACCESS_KEY"},
	} {
		got := c.set
		err := got.FromEnvironment(func(name string) string { return c.environment[name] })
		if c.problem != "" {
			if err == nil || !strings.Contains(err.Error(), c.problem) {
				t.Errorf("%s: error %v", name, err)
			}
			continue
		}
		if err != nil || got != c.want {
			t.Errorf("%s: %+v, %v", name, got, err)
		}
	}
}

// TestAStreamPastTheLastPartFails: the client would end the upload there and call it whole.
func TestAStreamPastTheLastPartFails(t *testing.T) {
	r := &boundedReader{strings.NewReader("12345"), 4}
	content := make([]byte, 4)
	if n, err := r.Read(content); n != 4 || err != nil {
		t.Fatalf("%d bytes, %v", n, err)
	}
	if n, err := r.Read(content); n != 0 || err == nil {
		t.Errorf("%d bytes more, %v", n, err)
	}
}
