package s3

import (
	"errors"
	"fmt"
	"net/url"
	"regexp"
	"strings"

	"github.com/minio/minio-go/v7"
	"github.com/minio/minio-go/v7/pkg/credentials"
)

// Options say where the bucket is. Bucket is required.
type Options struct {
	Bucket string
	// Prefix of all objects, without slashes at its ends; "": none.
	Prefix string
	// Endpoint is the store's URL; "": Amazon's.
	Endpoint string
	// Region of the bucket; "": what the store says, or us-east-1.
	Region string
	// SpoolDir holds files until their digest is known; "": the system's folder for temporary files.
	SpoolDir    string
	Credentials Credentials
}

// Credentials of the bucket's user.
type Credentials struct {
	AccessKey, SecretKey, SessionToken string
	// Ambient takes those that Amazon gives a machine or a pod, instead of the keys above.
	Ambient bool
}

const amazonEndpoint = "https://s3.amazonaws.com"

// ParseLocation reads s3://BUCKET or s3://BUCKET/PREFIX.
func ParseLocation(location string) (bucket, prefix string, err error) {
	rest, found := strings.CutPrefix(location, "s3://")
	if !found {
		return "", "", fmt.Errorf("is %q; want s3://BUCKET or s3://BUCKET/PREFIX", location)
	}
	bucket, prefix, _ = strings.Cut(rest, "/")
	prefix = strings.TrimSuffix(prefix, "/")
	switch {
	case !bucketPattern.MatchString(bucket):
		return "", "", fmt.Errorf("%q is no name of a bucket: want 3 to 63 small letters, digits, dots and hyphens", bucket)
	case prefix != "" && !prefixPattern.MatchString(prefix):
		return "", "", fmt.Errorf("prefix %q: want letters, digits, '.', '_' and '-' in parts separated by '/', "+
			"none of which begins with a dot", prefix)
	}
	return bucket, prefix, nil
}

var (
	bucketPattern = regexp.MustCompile(`^[a-z0-9][a-z0-9.-]{1,61}[a-z0-9]$`)
	prefixPattern = regexp.MustCompile(`^[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*$`)
)

// FromEnvironment sets what the usual variables of Amazon's tools say and the options do not yet:
// the region, the endpoint, and the credentials. It fails if there are none of these.
func (o *Options) FromEnvironment(getenv func(string) string) error {
	first := func(set string, names ...string) string {
		for _, name := range names {
			if set == "" {
				set = getenv(name)
			}
		}
		return set
	}
	o.Endpoint = first(o.Endpoint, "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
	o.Region = first(o.Region, "AWS_REGION", "AWS_DEFAULT_REGION")
	o.Credentials = Credentials{
		AccessKey: getenv("AWS_ACCESS_KEY_ID"), SecretKey: getenv("AWS_SECRET_ACCESS_KEY"),
		SessionToken: getenv("AWS_SESSION_TOKEN"),
	}
	ambient := first("", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
		"AWS_CONTAINER_CREDENTIALS_FULL_URI")
	switch c := &o.Credentials; {
	case c.AccessKey != "" && c.SecretKey != "":
		return nil
	case c.AccessKey != "" || c.SecretKey != "":
		return errors.New("AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY must be set both")
	case ambient == "":
		return errors.New("there are no credentials; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY")
	default:
		c.Ambient = true
		return nil
	}
}

// location names the bucket in errors.
func (o *Options) location() string {
	return strings.TrimSuffix("s3://"+o.Bucket+"/"+o.Prefix, "/")
}

func (o *Options) endpoint() string {
	if o.Endpoint == "" {
		return amazonEndpoint
	}
	return o.Endpoint
}

// CheckEndpoint tells what is wrong with a store's URL.
func CheckEndpoint(endpoint string) error {
	_, err := parseEndpoint(endpoint)
	return err
}

func parseEndpoint(endpoint string) (*url.URL, error) {
	u, err := url.Parse(endpoint)
	if err != nil || u.Scheme != "http" && u.Scheme != "https" || u.Host == "" || strings.Trim(u.Path, "/") != "" ||
		u.RawQuery != "" || u.User != nil {
		return nil, fmt.Errorf("endpoint %q: want http://HOST:PORT or https://HOST, without anything behind it", endpoint)
	}
	return u, nil
}

func (o *Options) client() (*minio.Client, error) {
	u, err := parseEndpoint(o.endpoint())
	if err != nil {
		return nil, err
	}
	keys := credentials.NewStaticV4(o.Credentials.AccessKey, o.Credentials.SecretKey, o.Credentials.SessionToken)
	if o.Credentials.Ambient {
		keys = credentials.NewIAM("")
	}
	return minio.New(u.Host, &minio.Options{Creds: keys, Secure: u.Scheme == "https", Region: o.Region})
}
